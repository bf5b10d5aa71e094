"""What the paper claims and what the issue wants reached, as data. How they are judged: `stages.analyze.verdicts`."""

from dataclasses import dataclass, replace
from typing import Literal

from stages.analyze.paper import ESTIMATOR_ERROR, ESTIMATOR_SOURCE, RESULTS, PaperResult

Rule = Literal["above", "keeps", "level", "at least", "at most"]
Quantity = Literal["return", "success", "area", "error"]

KEPT = 0.95
"""Share of the other's mean that counts as `keeps` or `nearly equals`."""
NEAR = 0.10
"""Share of our mean within which a level of the paper, read off its curves, counts as ours."""


@dataclass(frozen=True)
class Setting:
    """A group of the matrix, whatever the name of its runs and the kind of its misalignment."""

    task: str
    misalignment_deg: float
    scheme: str


@dataclass(frozen=True)
class Claim:
    """`subject` against `rival` or against `value`, under `rule`. An estimator's error has no subject."""

    id: str
    statement: str
    source: str
    rule: Rule
    quantity: Quantity
    subject: Setting | None
    rival: Setting | None = None
    value: float | None = None
    """A return, a rate, an error [m]; for `keeps` the share of the rival."""
    paper: str = ""
    """The paper's number as it gives it, with the place to find it in `source`."""


def _at(degrees: float) -> str:
    return f"{degrees:g}°"


def _order(task: str, degrees: float, above: str, below: str, source: str, quantity: Quantity = "return") -> Claim:
    what = {"return": "episode reward", "success": "success rate"}.get(quantity, quantity)
    return Claim(
        id=f"{task}-{below}-below-{above}-{degrees:g}" + ("" if quantity == "return" else f"-{quantity}"),
        statement=f"{task} at {_at(degrees)}: {below} ends below {above} ({what})",
        source=source,
        rule="above",
        quantity=quantity,
        subject=Setting(task, degrees, above),
        rival=Setting(task, degrees, below),
        paper=_difference(task, degrees, above, below, quantity),
    )


def _difference(task: str, degrees: float, above: str, below: str, quantity: Quantity) -> str:
    high, low = _paper(task, degrees, above, quantity), _paper(task, degrees, below, quantity)
    return f"{high} > {low}" if high and low else "“slightly” higher"


def _paper(task: str, degrees: float, scheme: str, quantity: Quantity) -> str:
    for row in RESULTS:
        if (row.task, row.misalignment_deg, row.scheme) == (task, degrees, scheme):
            value = row.episode_return if quantity == "return" else row.success_rate
            return "" if value is None else _number(value, quantity)
    return ""


def _number(value: float, quantity: Quantity) -> str:
    return f"{100 * value:g} %" if quantity == "success" else f"{value:g}"


def _keeps_oracle(task: str, degrees: float, source: str) -> Claim:
    return Claim(
        id=f"{task}-dense2sparse-oracle-{degrees:g}",
        statement=f"{task} at {_at(degrees)}: dense2sparse nearly equals the oracle (≥ {100 * KEPT:g} % of its reward)",
        source=source,
        rule="keeps",
        quantity="return",
        subject=Setting(task, degrees, "dense2sparse"),
        rival=Setting(task, degrees, "oracle"),
        value=KEPT,
        paper="nearly equal",
    )


def _falls(scheme: str, less: float, more: float, source: str) -> Claim:
    return Claim(
        id=f"reach-{scheme}-falls-{more:g}",
        statement=f"reach: {scheme} ends lower at {_at(more)} than at {_at(less)}",
        source=source,
        rule="above",
        quantity="return",
        subject=Setting("reach", less, scheme),
        rival=Setting("reach", more, scheme),
        paper=f"{_paper('reach', less, scheme, 'return')} > {_paper('reach', more, scheme, 'return')}",
    )


def _unchanged(degrees: float, quantity: Quantity) -> Claim:
    what = {"return": "episode reward", "success": "success rate"}[quantity]
    return Claim(
        id=f"reach-dense2sparse-unchanged-{degrees:g}-{quantity}",
        statement=f"reach: dense2sparse keeps its {what} at {_at(degrees)} (≥ {100 * KEPT:g} % of that at 0°)",
        source="§VI-A, Fig. 4",
        rule="keeps",
        quantity=quantity,
        subject=Setting("reach", degrees, "dense2sparse"),
        rival=Setting("reach", 0, "dense2sparse"),
        value=KEPT,
        paper="nearly unchanged",
    )


def _levels(result: PaperResult) -> list[Claim]:
    setting = Setting(result.task, result.misalignment_deg, result.scheme)
    numbers: list[tuple[Quantity, str, float | None]] = [
        ("return", "ends at about", result.episode_return),
        ("success", "succeeds in", result.success_rate),
    ]
    return [
        Claim(
            id=f"{result.task}-{result.scheme}-{quantity}-{result.misalignment_deg:g}",
            statement=f"{result.task} at {_at(result.misalignment_deg)}: {result.scheme} {verb} "
            f"{_number(value, quantity)}",
            source=result.source,
            rule="level",
            quantity=quantity,
            subject=setting,
            value=value,
            paper=_number(value, quantity),
        )
        for quantity, verb, value in numbers
        if value is not None
    ]


def _estimator(id: str, statement: str, source: str, limit: float) -> Claim:
    return Claim(id, statement, source, "at most", "error", None, value=limit, paper=f"{100 * limit:g} cm")


_ANGLES = (0.0, 5.0, 10.0)
_FIGURE = {0.0: "Fig. 4(a, b)", 5.0: "Fig. 4(c, d)", 10.0: "Fig. 4(e, f)"}

CLAIMS: tuple[Claim, ...] = (
    _estimator(
        "estimator", f"the estimator's mean test error is {100 * ESTIMATOR_ERROR:g} cm (ours: at most that)",
        ESTIMATOR_SOURCE, ESTIMATOR_ERROR,
    ),
    _order("reach", 0, "oracle", "dense2sparse", "§VI-A, Fig. 4(a): “slightly”"),
    *(_keeps_oracle("reach", degrees, f"§VI-A, {_FIGURE[degrees]}") for degrees in _ANGLES),
    *(_order("reach", degrees, "dense2sparse", "dense", f"§VI-A, {_FIGURE[degrees]}") for degrees in _ANGLES),
    *(_order("reach", degrees, "dense2sparse", "sparse", f"§VI-A, {_FIGURE[degrees]}") for degrees in _ANGLES),
    *(_falls(scheme, less, more, "§VI-A, Fig. 4(a, c, e)")
      for scheme in ("dense", "sparse") for less, more in ((0.0, 5.0), (5.0, 10.0))),
    *(_unchanged(degrees, quantity) for degrees in (5.0, 10.0) for quantity in ("return", "success")),
    Claim(
        "reach-sparse-slower", "reach at 0°: sparse learns slower than dense (area under the learning curve)",
        "§VI-A, Fig. 4(a)", "above", "area",
        Setting("reach", 0, "dense"), Setting("reach", 0, "sparse"), paper="“much slower”",
    ),
    _keeps_oracle("lift", 0, "§VI-B, Fig. 5(a)"),
    *(_order("lift", 0, "dense2sparse", rival, "§VI-B, Fig. 5", quantity)
      for rival in ("dense", "sparse") for quantity in ("return", "success")),
    *(claim for result in RESULTS for claim in _levels(result)),
)  # fmt: skip


def _target(setting: Setting, quantity: Quantity, value: float) -> Claim:
    where = f"{setting.task} at {_at(setting.misalignment_deg)}: {setting.scheme}"
    what = {"return": "episode reward", "success": "success rate"}[quantity]
    return Claim(
        id=f"target-{setting.task}-{setting.scheme}-{quantity}-{setting.misalignment_deg:g}",
        statement=f"{where}, {what}",
        source="target",
        rule="at least",
        quantity=quantity,
        subject=setting,
        value=value,
        paper=f"≥ {_number(value, quantity)}",
    )


def _share(degrees: float) -> Claim:
    return replace(
        _keeps_oracle("reach", degrees, "target"),
        id=f"target-reach-dense2sparse-oracle-{degrees:g}",
        statement=f"reach at {_at(degrees)}: dense2sparse, share of the oracle's episode reward",
        paper=f"≥ {100 * KEPT:g} %",
    )


TARGETS: tuple[Claim, ...] = (
    _estimator("target-estimator", "estimator, mean test error", "target", 0.01),
    _target(Setting("reach", 0, "oracle"), "return", 175),
    _target(Setting("reach", 0, "oracle"), "success", 1.0),
    *(_share(degrees) for degrees in _ANGLES),
    *(_target(Setting("lift", 0, scheme), "return", 330) for scheme in ("oracle", "dense2sparse")),
    *(_target(Setting("lift", 0, scheme), "success", 0.95) for scheme in ("oracle", "dense2sparse")),
)  # fmt: skip
"""What this project set itself to reach with the `laptop` profile."""
