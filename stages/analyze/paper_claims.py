"""What the text of the paper's §VI claims, each claim with its words or numbers. It compares no more than that."""

from stages.analyze.claims import KEPT, WHAT, Claim, Quantity, Setting, at, estimator, number
from stages.analyze.paper import ESTIMATOR_ERROR, ESTIMATOR_SOURCE, RESULTS, PaperResult


def _order(setting: Setting, below: str, source: str, paper: str, quantity: Quantity = "return") -> Claim:
    """`setting` ends above the scheme `below`."""
    task, degrees, above = setting.task, setting.misalignment_deg, setting.scheme
    return Claim(
        id=f"{task}-{below}-below-{above}-{degrees:g}" + ("" if quantity == "return" else f"-{quantity}"),
        statement=f"{task} at {at(degrees)}: {below} ends below {above} ({WHAT[quantity]})",
        source=source,
        rule="above",
        quantity=quantity,
        subject=setting,
        rival=Setting(task, degrees, below),
        paper=paper,
    )


def _slower(rival: str) -> Claim:
    return Claim(
        id=f"reach-sparse-slower-{rival}",
        statement=f"reach at 0°: sparse learns slower than {rival} ({WHAT['area']})",
        source="§VI-A, Fig. 4(a)",
        rule="above",
        quantity="area",
        subject=Setting("reach", 0, rival),
        rival=Setting("reach", 0, "sparse"),
        paper="“much slower”",
    )


def _falls(scheme: str, less: float, more: float, source: str, paper: str, quantity: Quantity = "return") -> Claim:
    return Claim(
        id=f"reach-{scheme}-falls-{more:g}" + ("" if quantity == "return" else f"-{quantity}"),
        statement=f"reach: {scheme} ends lower at {at(more)} than at {at(less)} ({WHAT[quantity]})",
        source=source,
        rule="above",
        quantity=quantity,
        subject=Setting("reach", less, scheme),
        rival=Setting("reach", more, scheme),
        paper=paper,
    )


def _keeps(id: str, said: str, subject: Setting, rival: Setting, source: str, paper: str, quantity: Quantity) -> Claim:
    statement = f"{said} ({WHAT[quantity]}: ≥ {100 * KEPT:g} %)"
    return Claim(id, statement, source, "keeps", quantity, subject, rival, KEPT, paper)


def _unchanged(degrees: float, quantity: Quantity) -> Claim:
    subject, rival = (Setting("reach", each, "dense2sparse") for each in (degrees, 0.0))
    said = f"reach: dense2sparse keeps at {at(degrees)} what it reaches at 0°"
    id = f"reach-dense2sparse-unchanged-{degrees:g}-{quantity}"
    return _keeps(id, said, subject, rival, "§VI-A, Fig. 4", "“nearly unchanged”", quantity)


def _spread(scheme: str) -> Claim:
    return Claim(
        id=f"lift-{scheme}-spread",
        statement=f"lift at 0°: success varies more between the seeds of {scheme} than of dense2sparse "
        "(standard deviation)",
        source="§VI-B, Fig. 5(b)",
        rule="spread",
        quantity="success",
        subject=Setting("lift", 0, scheme),
        rival=Setting("lift", 0, "dense2sparse"),
        paper="“quite large”, “nearly zero”",
    )


def _levels(result: PaperResult) -> list[Claim]:
    numbers: list[tuple[Quantity, str, float | None]] = [
        ("return", "ends at about", result.episode_return),
        ("success", "succeeds in", result.success_rate),
    ]
    return [
        Claim(
            id=f"{result.task}-{result.scheme}-{quantity}-{result.misalignment_deg:g}",
            statement=f"{result.task} at {at(result.misalignment_deg)}: {result.scheme} {verb} "
            f"{number(value, quantity)}",
            source=result.source,
            rule="level",
            quantity=quantity,
            subject=Setting(result.task, result.misalignment_deg, result.scheme),
            value=value,
            paper=number(value, quantity),
        )
        for quantity, verb, value in numbers
        if value is not None
    ]


_D2S, _DENSE = "dense2sparse", "dense"
_CURVES = {0: "§VI-A, Fig. 4(a)", 5: "§VI-A, Fig. 4(c)", 10: "§VI-A, Fig. 4(e)"}
_RATES = {5: "§VI-A, Fig. 4(d)", 10: "§VI-A, Fig. 4(f)"}
_NOT_AS_GOOD = "“its learning is not as good”"

CLAIMS: tuple[Claim, ...] = (
    estimator(
        "estimator", f"the estimator's mean test error is {100 * ESTIMATOR_ERROR:g} cm (ours: at most that)",
        ESTIMATOR_SOURCE, ESTIMATOR_ERROR,
    ),
    _order(Setting("reach", 0, "oracle"), _D2S, _CURVES[0], "“slightly higher”"),
    _order(Setting("reach", 0, _D2S), _DENSE, _CURVES[0], "“about 10 less”"),
    *(_order(Setting("reach", degrees, _D2S), _DENSE, _CURVES[degrees], _NOT_AS_GOOD) for degrees in (5, 10)),
    *(_order(Setting("reach", 0, scheme), "sparse", _CURVES[0], "“much lower than other ablations”")
      for scheme in ("oracle", _D2S, _DENSE)),
    *(_order(Setting("reach", degrees, _D2S), "sparse", _CURVES[degrees], paper)
      for degrees, paper in ((5, "175, about 80"), (10, "175, 55"))),
    *(_order(Setting("reach", degrees, _DENSE), "sparse", _CURVES[degrees], paper)
      for degrees, paper in ((5, "“about 75 […] higher”"), (10, "“50 higher”"))),
    *(_order(Setting("reach", degrees, _D2S), "sparse", _RATES[degrees], paper, "success")
      for degrees, paper in ((5, "100 %, 50 %"), (10, "100 %, 33 %"))),
    _falls("sparse", 0, 5, _CURVES[5], "120 → 80"), _falls("sparse", 5, 10, _CURVES[10], "80 → 55"),
    _falls("sparse", 0, 5, _RATES[5], "95 % → 50 %", "success"),
    _falls("sparse", 5, 10, _RATES[10], "50 % → 33 %", "success"),
    *(_falls(_DENSE, less, more, "§VI-A, Fig. 4", "“an episode reward reduction”") for less, more in ((0, 5), (5, 10))),
    *(_unchanged(degrees, quantity) for degrees in (5, 10) for quantity in ("return", "success")),
    *(_slower(rival) for rival in (_D2S, _DENSE)),
    _keeps(
        "reach-dense-converges-like-dense2sparse", "reach at 0°: dense learns as fast as dense2sparse",
        Setting("reach", 0, _DENSE), Setting("reach", 0, _D2S), _CURVES[0], "“a similar convergence”", "area",
    ),
    _keeps(
        "lift-dense2sparse-oracle-0", "lift at 0°: dense2sparse nearly equals the oracle",
        Setting("lift", 0, _D2S), Setting("lift", 0, "oracle"), "§VI-B, Fig. 5(a)", "“nearly equals”", "return",
    ),
    *(_order(Setting("lift", 0, _D2S), rival, "§VI-B, Fig. 5(a)", "350, 260") for rival in (_DENSE, "sparse")),
    *(_order(Setting("lift", 0, scheme), rival, "§VI-B, Fig. 5(b)", "“much lower”", "success")
      for scheme in (_D2S, "oracle") for rival in (_DENSE, "sparse")),
    *(_spread(scheme) for scheme in (_DENSE, "sparse")),
    *(claim for result in RESULTS for claim in _levels(result)),
)  # fmt: skip
