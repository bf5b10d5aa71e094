"""Claims judged by our runs, by rules that are the same for every claim."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.analyze.claims import Claim, Quantity, Setting
from stages.analyze.results import Group, Row
from stages.analyze.rules import decide
from stages.analyze.statistics import BySeed, Statistics, Summary


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
    counted = [side.counted(_scores(side, judged.claim.quantity)) for side in sides]
    other = _judge(judged.claim, counted, statistics).verdict
    if other == judged.verdict:
        notes = [judged.note, "the same with failed runs counted as 0"]
        return replace(judged, note="; ".join(note for note in notes if note))
    note = f"{judged.verdict} without the failed runs, {other} with them counted as 0"
    return replace(judged, verdict="not reproduced", note=note)


def _judge(claim: Claim, sides: Sequence[BySeed], statistics: Statistics) -> Judged:
    ours = statistics.of(sides[0].values())
    rival = statistics.of(sides[1].values()) if len(sides) > 1 else None
    if ours is None or (len(sides) > 1 and rival is None):
        return Judged(claim)
    found = _effect(claim, sides, ours, rival, statistics)
    if found is None:
        return Judged(claim, note="no seed in common")
    seeds, effect, low, high = found
    larger = max(abs(ours.mean), 0.0 if rival is None else abs(rival.mean))
    verdict, note = decide(claim, seeds, effect, low, high, larger)
    return Judged(
        claim, ours=ours, rival=rival, seeds=seeds, effect=effect, low=low, high=high, verdict=verdict, note=note
    )


def _effect(
    claim: Claim, sides: Sequence[BySeed], ours: Summary, rival: Summary | None, statistics: Statistics
) -> tuple[int, float, float | None, float | None] | None:
    """Seeds, what decides and its interval."""
    if rival is None:
        return ours.n, ours.mean, ours.low, ours.high
    if claim.rule == "spread":
        difference = np.nan if ours.std is None or rival.std is None else ours.std - rival.std
        return min(ours.n, rival.n), difference, None, None
    return statistics.paired(sides[0], sides[1], _ratio if claim.is_share else np.subtract)


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.divide(a, b)


def _error(claim: Claim, estimator: str, error: float) -> Judged:
    """One estimator was trained, so that there is no spread over seeds."""
    summary = Summary(1, error, None, error, None, None, None, None)
    verdict, note = decide(claim, 1, error, None, None, error)
    return Judged(claim, estimator, ours=summary, seeds=1, effect=error, verdict=verdict, note=note)


def flat(judged: Sequence[Judged]) -> list[Row]:
    """One row a verdict."""
    return [_flat(each) for each in judged]


def _flat(each: Judged) -> Row:
    claim, ours = each.claim, each.ours
    row: Row = {key: getattr(claim, key) for key in ("id", "statement", "source", "rule", "quantity", "paper")}
    row |= {key: getattr(each, key) for key in ("name", "misalignment_kind", "treatment", "variant")}
    for part in ("mean", "std", "low", "high", "iqm", "iqm_low", "iqm_high"):
        row[f"ours_{part}"] = None if ours is None else getattr(ours, part)
    for part in ("mean", "std"):
        row[f"rival_{part}"] = None if each.rival is None else getattr(each.rival, part)
    row |= {"effect": each.effect, "effect_low": each.low, "effect_high": each.high}
    return row | {key: getattr(each, key) for key in ("seeds", "failed", "verdict", "note")}
