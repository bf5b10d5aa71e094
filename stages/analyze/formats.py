"""Numbers as people read them, the same in the report and in the evidence."""

import math
from typing import Any

from stages.analyze.claims import Quantity
from stages.analyze.results import Row, misalignment
from stages.analyze.statistics import Summary
from stages.analyze.verdicts import Judged

_UNITS: dict[Quantity, tuple[float, str, int]] = {  # scale, unit, digits
    "return": (1.0, "", 1),
    "success": (100.0, " %", 1),
    "error": (100.0, " cm", 2),
    "area": (1.0, "", 3),
}


def figure(value: float | None, digits: int = 1, scale: float = 1) -> str:
    """A number; – where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value * scale:.{digits}f}".replace("-", "−")


def signed(value: float | None, digits: int = 1) -> str:
    """A difference; one that rounds to zero has no sign."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:+.{digits}f}"
    return text.replace("-", "−") if float(text) else f"{0:.{digits}f}"


def interval(summary: Summary | None, digits: int = 1, scale: float = 1) -> str:
    """`low to high` of the mean; – where one seed has none."""
    if summary is None or summary.low is None:
        return "–"
    return f"{figure(summary.low, digits, scale)} to {figure(summary.high, digits, scale)}"


def iqm(summary: Summary | None, digits: int = 1, scale: float = 1) -> str:
    """Interquartile mean with its interval."""
    if summary is None:
        return "–"
    said = figure(summary.iqm, digits, scale)
    if summary.iqm_low is None:
        return said
    return f"{said} ({figure(summary.iqm_low, digits, scale)} to {figure(summary.iqm_high, digits, scale)})"


def compared(seeds: int, difference: float, low: float | None, high: float | None, confidence: str) -> str:
    """A difference of means over the seeds that both sides have."""
    if low is None or high is None:
        return f"{signed(difference)} on the one seed in common, which says nothing about the spread"
    return f"{signed(difference)} ({confidence} interval {signed(low)} to {signed(high)}, {seeds} seeds in common)"


def quantity(value: float | None, judged: Judged) -> str:
    """A number of a verdict: a rate in percent, an error in centimetres, a return or a share as it is."""
    scale, unit, digits = _UNITS[judged.claim.quantity]
    return "–" if value is None else figure(value, digits, scale) + unit


def quantity_interval(judged: Judged) -> str:
    """Interval of our mean, in the units of `quantity`."""
    scale, _, digits = _UNITS[judged.claim.quantity]
    return interval(judged.ours, digits, scale)


def quantity_iqm(judged: Judged) -> str:
    """Interquartile mean with its interval, in the units of `quantity`."""
    scale, _, digits = _UNITS[judged.claim.quantity]
    return iqm(judged.ours, digits, scale)


def effect(value: float | None, judged: Judged) -> str:
    """The difference or ratio that decides a verdict; a difference of rates is in percentage points."""
    if value is None:
        return "–"
    if judged.claim.is_share:
        return figure(value, 3)
    if judged.claim.quantity == "success":
        return f"{signed(100 * value)} pp"
    return signed(value, _UNITS[judged.claim.quantity][2])


def deciding(judged: Judged) -> str:
    """The other side's mean, and the difference or ratio with its interval; nothing where our mean itself decides."""
    if judged.rival is None or judged.effect is None:
        return ""
    if judged.claim.rule == "spread" and judged.ours is not None:
        ours, rival = (figure(None if side.std is None else 100 * side.std) for side in (judged.ours, judged.rival))
        return f"standard deviations {ours} pp and {rival} pp; {effect(judged.effect, judged)}"
    ratio = "× " if judged.claim.is_share else ""
    said = f"{quantity(judged.rival.mean, judged)}; {ratio}{effect(judged.effect, judged)}"
    if judged.low is None:
        return said
    return f"{said} ({effect(judged.low, judged)} to {effect(judged.high, judged)})"


def camera(item: Any) -> str:
    """How the camera of a group or a row of an answer was turned."""
    row = item if isinstance(item, dict) else vars(item)
    return misalignment(row["misalignment_kind"], row["misalignment_deg"])


def share_ending(row: Row, ending: str) -> str:
    """Share of a group's episodes that end so, and what they earn; – where none does."""
    if not row[ending]:
        return "–"
    return f"{figure(row[ending] / row['episodes'], 1, 100)} % ({figure(row[f'{ending}_return'], 0)})"


FILTERS = {
    "figure": figure,
    "signed": signed,
    "interval": interval,
    "iqm": iqm,
    "quantity_iqm": quantity_iqm,
    "quantity": quantity,
    "quantity_interval": quantity_interval,
    "deciding": deciding,
    "camera": camera,
    "share_ending": share_ending,
}
