"""Claims judged by our runs, by rules that are the same for every claim."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from stages.analyze.claims import NEAR, Claim, Quantity, Setting
from stages.analyze.results import BySeed, Group, Row, Statistics
from stages.analyze.statistics import Summary

RULES = {
    "above": (
        "order (A above B): reproduced when the bootstrap interval of the difference of the means lies above 0, "
        "different when it lies below 0 (the opposite), else not reproduced (not shown)"
    ),
    "keeps": "keeps, nearly equals: reproduced when the ratio of the means is at least 0.95, else not reproduced",
    "level": (
        "level (about V): reproduced when V lies within the interval of our mean or within 10 % of our mean, "
        "else different"
    ),
    "at most": "at most V: reproduced when our mean is no larger than V, else not reproduced",
    "at least": "at least V: reproduced when our mean is no smaller than V, else not reproduced",
    "failed": ("failed runs: a claim that holds only without them, or only with them counted as 0, is not reproduced"),
}
"""Differences and ratios resample the seeds of both sides jointly: the schemes share them."""


@dataclass(frozen=True)
class Judged:
    """A claim and what our runs say to it. `effect`: difference, ratio, or our mean itself."""

    claim: Claim
    name: str | None = None  # of the runs, or of the estimator
    misalignment_kind: str | None = None
    treatment: str | None = None  # of dense2sparse at the switch
    variant: str | None = None  # STUDY: VALUES, where dense2sparse is that of a study
    ours: Summary | None = None
    rival: Summary | None = None
    seeds: int = 0  # common to both sides
    effect: float | None = None
    low: float | None = None
    high: float | None = None
    failed: int = 0
    verdict: str = "not measured"  # reproduced | different | not reproduced | not measured
    note: str = ""


def judge(
    claims: Sequence[Claim], groups: Sequence[Group], errors: Mapping[str, float], statistics: Statistics
) -> list[Judged]:
    """Every claim, for every name and kind of misalignment that `groups` have; `errors` [m] are the estimators'."""
    settings = list(dict.fromkeys((group.name, group.misalignment_kind) for group in groups))
    judged = []
    for claim in claims:
        if claim.subject is None:
            judged += [_error(claim, name, error) for name, error in errors.items()] or [Judged(claim)]
            continue
        found = [_of_runs(claim, *setting, groups, statistics) for setting in settings]
        judged += [each for each in found if each.verdict != "not measured"] or found[:1] or [Judged(claim)]
    return judged


def judge_variant(
    claims: Sequence[Claim], groups: Sequence[Group], variant: Sequence[Group], label: str, statistics: Statistics
) -> list[Judged]:
    """The claims about dense2sparse with the groups of `variant` in its place and everything else from `groups`."""
    settings = list(dict.fromkeys((group.name, group.misalignment_kind) for group in groups))
    judged = []
    for name, kind in settings:
        others = [group for group in groups if group.scheme != "dense2sparse"]
        mixed = [*others, *(replace(group, name=name) for group in variant)]
        about = [claim for claim in claims if "dense2sparse" in (_scheme(claim.subject), _scheme(claim.rival))]
        judged += [replace(_of_runs(claim, name, kind, mixed, statistics), variant=label) for claim in about]
    return [each for each in judged if each.verdict != "not measured"]


def _scheme(setting: Setting | None) -> str | None:
    return setting.scheme if setting else None


def _matches(setting: Setting, group: Group) -> bool:
    same = (setting.task, setting.scheme) == (group.task, group.scheme)
    return same and abs(setting.misalignment_deg - group.misalignment_deg) < 1e-3


def _of_runs(claim: Claim, name: str, kind: str, groups: Sequence[Group], statistics: Statistics) -> Judged:
    there = [
        side for setting in (claim.subject, claim.rival) if setting and (side := _find(setting, name, kind, groups))
    ]
    if len(there) < 1 + (claim.rival is not None):
        return Judged(claim, name, kind)
    empty = [side for side in there if not _scores(side, claim.quantity)]
    if empty:
        return _without_scores(Judged(claim, name, kind), empty)
    judged = _judge(claim, [_scores(side, claim.quantity) for side in there], statistics)
    failed = sum(side.failed for side in there)
    if failed:
        judged = _with_failed(judged, there, statistics)
    treatment = next((side.treatment for side in there if side.treatment), None)
    return replace(judged, name=name, misalignment_kind=kind, treatment=treatment, failed=failed)


def _without_scores(judged: Judged, empty: Sequence[Group]) -> Judged:
    """Nothing was measured where nothing ran; where every run failed that is an answer."""
    lost = [side for side in empty if side.failed and not side.running]
    if not lost:
        return judged
    note = ", ".join(f"every run of {side.scheme} at {side.misalignment_deg:g}° failed" for side in lost)
    return replace(judged, failed=sum(side.failed for side in lost), verdict="not reproduced", note=note)


def _find(setting: Setting, name: str, kind: str, groups: Sequence[Group]) -> Group | None:
    mine = [group for group in groups if (group.name, group.misalignment_kind) == (name, kind)]
    return next((group for group in mine if _matches(setting, group)), None)


def _scores(group: Group, quantity: Quantity) -> BySeed:
    scores = group.scores
    return {"return": scores.returns, "success": scores.success, "area": scores.area}[quantity]


def _with_failed(judged: Judged, sides: Sequence[Group], statistics: Statistics) -> Judged:
    """The verdict that holds with the failed runs left out as well as counted as 0."""
    counted = [dict.fromkeys(side.failed_seeds, 0.0) | dict(_scores(side, judged.claim.quantity)) for side in sides]
    other = _judge(judged.claim, counted, statistics).verdict
    if other == judged.verdict:
        return replace(judged, note="the same with failed runs counted as 0")
    note = f"{judged.verdict} without the failed runs, {other} with them counted as 0"
    return replace(judged, verdict="not reproduced", note=note)


def _judge(claim: Claim, sides: Sequence[BySeed], statistics: Statistics) -> Judged:
    ours = statistics.of(sides[0].values())
    rival = statistics.of(sides[1].values()) if len(sides) > 1 else None
    if ours is None or (len(sides) > 1 and rival is None):
        return Judged(claim)
    if rival is None:
        found: tuple[int, float, float | None, float | None] | None = (ours.n, ours.mean, ours.low, ours.high)
    else:
        found = statistics.paired(sides[0], sides[1], _ratio if claim.rule == "keeps" else np.subtract)
    if found is None:
        return Judged(claim, note="no seed in common")
    seeds, effect, low, high = found
    verdict = _verdict(claim, effect, low, high)
    note = "one seed has no interval" if seeds == 1 and claim.rule == "above" else ""
    return Judged(
        claim, ours=ours, rival=rival, seeds=seeds, effect=effect, low=low, high=high, verdict=verdict, note=note
    )


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.divide(a, b)


def _verdict(claim: Claim, effect: float, low: float | None, high: float | None) -> str:
    value = claim.value or 0.0
    if claim.rule == "above":
        if low is None or high is None:
            return "not reproduced"
        return "reproduced" if low > 0 else "different" if high < 0 else "not reproduced"
    if claim.rule == "level":
        within = low is not None and high is not None and low <= value <= high
        return "reproduced" if within or abs(value - effect) <= NEAR * abs(effect) else "different"
    if claim.rule == "at most":
        return "reproduced" if effect <= value else "not reproduced"
    return "reproduced" if np.isfinite(effect) and effect >= value else "not reproduced"


def _error(claim: Claim, estimator: str, error: float) -> Judged:
    """One estimator was trained, so that there is no spread over seeds."""
    summary = Summary(1, error, None, error, None, None)
    verdict = _verdict(claim, error, None, None)
    return Judged(claim, estimator, ours=summary, seeds=1, effect=error, verdict=verdict)


def flat(judged: Sequence[Judged]) -> list[Row]:
    """One row a verdict."""
    return [_flat(each) for each in judged]


def _flat(each: Judged) -> Row:
    claim, ours = each.claim, each.ours
    row: Row = {key: getattr(claim, key) for key in ("id", "statement", "source", "rule", "quantity", "paper")}
    row |= {key: getattr(each, key) for key in ("name", "misalignment_kind", "treatment", "variant")}
    for part in ("mean", "low", "high", "iqm"):
        row[f"ours_{part}"] = None if ours is None else asdict(ours)[part]
    row["rival_mean"] = None if each.rival is None else each.rival.mean
    row |= {"effect": each.effect, "effect_low": each.low, "effect_high": each.high}
    return row | {key: getattr(each, key) for key in ("seeds", "failed", "verdict", "note")}
