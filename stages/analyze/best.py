"""Which variant of a study is best, and what may be said of it. A failed seed counts as 0."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from stages.analyze.formats import compared
from stages.analyze.results import misalignment, order
from stages.analyze.statistics import BySeed, Statistics
from stages.analyze.studies import Study, Variant

TREATMENT = ("policy.buffer", "policy.reset", "policy.reset_updates")
"""Keys of what becomes of replay buffer and networks at the switch, on which the paper is silent."""


def best_treatments(found: Sequence[Variant], studies: Sequence[Study]) -> list[tuple[Study, list[Variant]]]:
    """For each main matrix and task the variant of dense2sparse with the best treatment, in every setting it ran in.

    Best: the highest mean return at the largest misalignment that any variant of the task ran at, the main runs' own
    treatment among them. Where theirs is the best there is nothing to show beside them.
    """
    treated = {study.name: study for study in studies if set(study.keys) & set(TREATMENT)}
    candidates = [v for v in found if v.study in treated and v.group.scheme == "dense2sparse" and v.group.returns]
    chosen = []
    for main, task in dict.fromkeys((treated[v.study].main, v.group.task) for v in candidates if not v.main):
        mine = [v for v in candidates if (treated[v.study].main, v.group.task) == (main, task)]
        largest = max(v.group.misalignment_deg for v in mine if not v.main)
        best = max((v for v in mine if v.group.misalignment_deg == largest), key=_mean)
        if best.main:
            continue
        same = [v for v in mine if (v.study, v.group.name) == (best.study, best.group.name)]
        chosen.append((treated[best.study], same))
    return chosen


def sentences(found: Sequence[Variant], statistics: Statistics, confidence: str) -> list[str]:
    """For each setting of one study its best variant beside the main runs, said no more strongly than the seeds allow.

    The best is picked by the numbers that it is then judged by, which flatters it.
    """
    settings: dict[tuple[Any, ...], list[Variant]] = {}
    for each in found:
        settings.setdefault(order(each.group)[1:], []).append(each)
    return [_sentence(members, statistics, confidence) for members in settings.values()]


def _sentence(members: Sequence[Variant], statistics: Statistics, confidence: str) -> str:
    group = members[0].group
    where = f"{group.task}, {misalignment(group.misalignment_kind, group.misalignment_deg)}, {group.scheme}"
    varied = [v for v in members if not v.main]
    judged = [v for v in varied if v.group.returns]
    failed = _failures(members)
    count = f"{len(varied)} variant{'s' * (len(varied) != 1)}"
    if not judged:
        return f"{where}: of {count} none has been evaluated.{failed}"
    best = max(judged, key=_mean)
    said = f"{where}: of {count} {len(judged)} evaluated, highest is {best.said} with {_mean(best):.1f}"
    reference = next((v for v in members if v.main and v.group.returns), None)
    if reference is None:
        return f"{said}; there is no main run to compare it with.{failed}"
    said += f"; the main runs ({reference.said}) end at {_mean(reference):.1f}"
    paired = statistics.paired(_returns(best), _returns(reference), np.subtract)
    if paired is None:
        return f"{said}, with no seed in common.{failed}"
    _, _, low, high = paired
    said += f": {compared(*paired, confidence)}"
    if low is None or high is None:
        return f"{said}.{failed}"
    shown = "higher" if low > 0 else "lower" if high < 0 else "not shown to differ"
    return f"{said}, {shown}.{failed}"


def _failures(members: Sequence[Variant]) -> str:
    failed = [f"{v.group.failed} of {'the main runs' if v.main else v.said}" for v in members if v.group.failed]
    return f" Failed runs, counted as 0 here: {'; '.join(failed)}." if failed else ""


def _returns(variant: Variant) -> BySeed:
    return variant.group.counted(variant.group.scores.returns)


def _mean(variant: Variant) -> float:
    return float(np.mean(list(_returns(variant).values())))
