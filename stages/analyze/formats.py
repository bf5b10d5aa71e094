"""Numbers as people read them, the same in the report and in the evidence."""

import math
from typing import Any

from stages.analyze.results import misalignment
from stages.analyze.statistics import Summary
from stages.analyze.verdicts import Judged


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


def quantity(value: float | None, judged: Judged) -> str:
    """A number of a verdict: a rate in percent, an error in centimetres, a return as it is."""
    scale, unit, digits = {"success": (100.0, " %", 1), "error": (100.0, " cm", 2)}.get(
        judged.claim.quantity, (1.0, "", 1)
    )
    return "–" if value is None else figure(value, digits, scale) + unit


def quantity_interval(judged: Judged) -> str:
    """Interval of our mean, in the units of `quantity`."""
    return interval(judged.ours, 1, 100 if judged.claim.quantity == "success" else 1)


def effect(value: float | None, judged: Judged) -> str:
    """The difference or ratio that decides a verdict; a difference of rates is in percentage points."""
    if value is None:
        return "–"
    if judged.claim.rule == "keeps":
        return figure(value, 3)
    return f"{signed(100 * value)} pp" if judged.claim.quantity == "success" else signed(value)


def deciding(judged: Judged) -> str:
    """The other side's mean, and the difference or ratio with its interval; nothing where our mean itself decides."""
    if judged.rival is None or judged.effect is None:
        return ""
    ratio = "× " if judged.claim.rule == "keeps" else ""
    said = f"{quantity(judged.rival.mean, judged)}; {ratio}{effect(judged.effect, judged)}"
    if judged.low is None:
        return said
    return f"{said} ({effect(judged.low, judged)} to {effect(judged.high, judged)})"


def camera(item: Any) -> str:
    """How the camera of a group or a row of an answer was turned."""
    row = item if isinstance(item, dict) else vars(item)
    return misalignment(row["misalignment_kind"], row["misalignment_deg"])


FILTERS = {
    "figure": figure,
    "signed": signed,
    "interval": interval,
    "quantity": quantity,
    "quantity_interval": quantity_interval,
    "deciding": deciding,
    "camera": camera,
}
