"""Runs side by side: where they ended, how sure a difference is, and in which settings they differ."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schemas.config import flatten
from schemas.errors import ArtifactError
from stages.analyze.catalogue import artifacts, select
from stages.analyze.config import AnalyzeConfig
from stages.analyze.results import IDENTITY, Answer, Group, Row, groups, misalignment
from stages.analyze.statistics import Statistics
from stages.analyze.study import ask

_OR = " or "
QUESTIONS = ("runs", "outcomes", "learning-area", "learning-curves")


@dataclass(frozen=True)
class Contest:
    """A group against the first one of its task; a failed run counts as a return of 0."""

    group: str
    baseline: str
    improvement: float
    """Probability that a run of the group ends above one of the baseline (Agarwal et al. 2021); 0.5: no difference."""
    low: float | None  # bootstrap interval; None with one seed each
    high: float | None
    difference: float  # of the means over the seeds in common; where there are none, of all
    seeds: int  # in common
    difference_low: float | None  # resampled by the seeds in common
    difference_high: float | None


@dataclass(frozen=True)
class Setting:
    """A key of the configuration that is not the same in all runs, with what it is in each group."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """What `pipeline compare` shows; `labels` and the values of every setting are in the order of `groups`."""

    labels: tuple[str, ...]
    groups: tuple[Group, ...]
    contests: tuple[Contest, ...]
    settings: tuple[Setting, ...]
    curves: Answer
    confidence: float  # of the intervals

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "groups": [
                {"label": label, **asdict(group)} for label, group in zip(self.labels, self.groups, strict=True)
            ],
            "contests": [asdict(contest) for contest in self.contests],
            "settings": [asdict(setting) for setting in self.settings],
        }


def compare(data_root: Path, names: Sequence[str], config: AnalyzeConfig) -> Comparison:
    """Compare runs; those of one NAME, task, misalignment and scheme are one group, its seeds.

    `names` are NAMEs or NAME/CELL. The order of the groups is that of `names`, and the first of each task is what the
    others of that task are measured against.

    Raises:
        ArtifactError: an unknown name, or nothing evaluated yet.
    """
    chosen = select(artifacts(data_root, "runs"), names)
    answers = ask(data_root, chosen, QUESTIONS)
    statistics = Statistics(config)
    rows = answers["runs"].rows
    found = groups(rows, answers["outcomes"].rows, answers["learning-area"].rows, statistics)
    if not any(group.returns for group in found):
        raise ArtifactError("nothing to compare: none of these runs has been evaluated yet")
    place = {run.name: position for position, run in enumerate(chosen)}
    found.sort(key=lambda group: min(place[row["run"]] for row in rows if _is_of(row, group)))
    labels = _labels(found)
    return Comparison(
        labels,
        tuple(found),
        tuple(_contests(labels, found, statistics)),
        tuple(_settings([[run.manifest.config for run in chosen if _member(run.name, rows, g)] for g in found])),
        answers["learning-curves"],
        config.confidence,
    )


def _labels(found: Sequence[Group]) -> tuple[str, ...]:
    """Of name, task, misalignment and scheme those that tell them apart, or the scheme."""
    parts = [
        (group.name, group.task, misalignment(group.misalignment_kind, group.misalignment_deg), group.scheme)
        for group in found
    ]
    telling = [column for column in range(4) if len({part[column] for part in parts}) > 1] or [3]
    return tuple(" ".join(part[column] for column in telling) for part in parts)


def _contests(labels: Sequence[str], found: Sequence[Group], statistics: Statistics) -> list[Contest]:
    made = []
    for task in dict.fromkeys(group.task for group in found):
        (first, baseline), *others = [(x, group) for x, group in zip(labels, found, strict=True) if group.task == task]
        for label, group in others:
            contest = _contest(label, group, first, baseline, statistics)
            made += [contest] if contest else []
    return made


def _contest(label: str, group: Group, first: str, baseline: Group, statistics: Statistics) -> Contest | None:
    """None where one of them has not been evaluated."""
    mine, theirs = group.counted(group.scores.returns), baseline.counted(baseline.scores.returns)
    improvement = statistics.improvement(mine.values(), theirs.values())
    paired = statistics.paired(mine, theirs, lambda a, b: a - b)
    if improvement is None:
        return None
    apart = float(np.mean(list(mine.values())) - np.mean(list(theirs.values())))
    seeds, difference, low, high = paired or (0, apart, None, None)
    return Contest(label, first, *improvement, difference, seeds, low, high)


def _settings(configs: Sequence[Sequence[dict[str, Any]]]) -> list[Setting]:
    """Keys that differ between groups or within one; who a run is (`run.*`) the labels say."""
    flattened = [[dict(flatten(config)) for config in group] for group in configs]
    keys = dict.fromkeys(key for group in flattened for config in group for key in config if not key.startswith("run."))
    found = []
    for key in keys:
        values = tuple(_OR.join(dict.fromkeys(_text(c.get(key)) for c in group)) for group in flattened)
        if len(set(values)) > 1 or any(_OR in value for value in values):
            found.append(Setting(key, values))
    return found


def _text(value: Any) -> str:
    return "–" if value is None else value if isinstance(value, str) else json.dumps(value)


def _is_of(row: Row, group: Group) -> bool:
    return all(row[key] == getattr(group, key) for key in IDENTITY)


def _member(run: str, rows: Sequence[Row], group: Group) -> bool:
    return any(row["run"] == run and _is_of(row, group) for row in rows)
