"""The rules of the verdicts, the same for every claim."""

import numpy as np

from stages.analyze.claims import KEPT, LEAST, NEAR, Claim

_SLACK = 1e-9
"""Of thresholds: three times 0.95 has a mean just below 0.95."""

RULES = {
    "above": (
        "order (A above B): reproduced when the bootstrap interval of the difference of the means lies above 0, "
        "different when it lies below 0 (the opposite), else not reproduced (not shown); also not reproduced when the "
        f"difference is below {100 * LEAST:g} % of the larger mean, whatever its interval. With 3 seeds the interval "
        "leaves out 0 only if all seeds agree, which happens by luck in 1 of 8 cases in each direction"
    ),
    "keeps": (
        f"keeps, nearly equals: reproduced when the interval of the ratio of the means starts at {KEPT:g} or above, "
        f"different when it ends below {KEPT:g}, else not reproduced (not shown)"
    ),
    "level": (
        f"level (about V): reproduced when our mean is within {100 * NEAR:g} % of V; not reproduced (not shown) when "
        "it is farther off but V lies within the interval of our mean; else different"
    ),
    "spread": (
        "spread (A varies more than B): by the sign of the difference of the standard deviations over the seeds, "
        "which so few seeds cannot show"
    ),
    "at most": "at most V: reproduced when our mean is no larger than V, else not reproduced",
    "at least": (
        "what this project set itself to reach: reached by the mean when our mean, or the ratio of the means, is no "
        "smaller than V, whatever the interval"
    ),
    "failed": "failed runs: a claim that holds only without them, or only with them counted as 0, is not reproduced",
}
"""Differences and ratios resample the seeds of both sides jointly: the schemes share them."""

_NOT_SHOWN = "not shown"


def decide(
    claim: Claim, seeds: int, effect: float, low: float | None, high: float | None, larger: float
) -> tuple[str, str]:
    """Verdict and note on `effect`: difference, ratio or mean over `seeds`, its interval, the `larger` of the means."""
    value = 0.0 if claim.value is None else claim.value
    match claim.rule:
        case "above" if abs(effect) < LEAST * larger:
            return "not reproduced", f"differ by less than {100 * LEAST:g} %"
        case "above":
            return _by_interval(low, high, 0.0, strictly=True)
        case "keeps":
            return _by_interval(low, high, value) if np.isfinite(effect) else ("not reproduced", "")
        case "level":
            return _level(value, effect, low, high)
        case "spread" if seeds < 2:
            return "not reproduced", "one seed has no spread"
        case "spread":
            verdict = "reproduced" if effect > 0 else "different" if effect < 0 else "not reproduced"
            return verdict, f"{seeds} seeds cannot show it"
        case "at most":
            return ("reproduced" if effect <= value + _SLACK else "not reproduced"), ""
        case "at least":
            return ("reproduced" if np.isfinite(effect) and effect >= value - _SLACK else "not reproduced"), ""


def _by_interval(low: float | None, high: float | None, value: float, *, strictly: bool = False) -> tuple[str, str]:
    """Whether the interval lies above `value` (or starts at it, unless `strictly`), or below."""
    if low is None or high is None:
        return "not reproduced", "one seed has no interval"
    if low > value or (not strictly and low >= value - _SLACK):
        return "reproduced", ""
    return ("different", "") if high < value - (0.0 if strictly else _SLACK) else ("not reproduced", _NOT_SHOWN)


def _level(value: float, mean: float, low: float | None, high: float | None) -> tuple[str, str]:
    if abs(value - mean) <= NEAR * abs(value) + _SLACK:
        return "reproduced", ""
    within = low is not None and high is not None and low - _SLACK <= value <= high + _SLACK
    return ("not reproduced", _NOT_SHOWN) if within else ("different", "")
