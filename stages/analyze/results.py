"""Runs gathered into groups that differ in nothing but the seed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from stages.analyze.config import AnalyzeConfig
from stages.analyze.paper import RESULTS, PaperResult
from stages.analyze.statistics import Summary, paired_interval, summarise

SCHEMES = ("oracle", "dense2sparse", "dense", "sparse")
"""In the order of every table and legend: first the one that knows the truth, then the paper's, then its rivals."""

Row = dict[str, Any]
_KEY = ("name", "task", "misalignment_kind", "misalignment_deg", "scheme")

BySeed = Mapping[int, float]


@dataclass(frozen=True)
class Answer:
    """A question and its rows."""

    sql: str
    rows: list[Row]


@dataclass(frozen=True)
class Scores:
    """What each seed of a group reached."""

    returns: BySeed
    success: BySeed
    area: BySeed  # under the learning curve, over its length: mean reward of the evaluations while training


@dataclass(frozen=True)
class Group:
    """The seeds of one study, task, misalignment and scheme, and where they ended."""

    name: str
    task: str
    misalignment_kind: str
    misalignment_deg: float
    scheme: str
    treatment: str | None  # of buffer and networks at the switch, `keep, none`; None where there is no switch
    seeds: tuple[int, ...]
    failed: int
    failed_seeds: tuple[int, ...]
    running: int
    judged_by: str  # final | eval | eval, final
    episodes: int  # in the smallest of those evaluations; 0 when there is none
    returns: Summary | None  # dense true reward, whatever the runs trained on
    success: Summary | None
    steps_to_success: Summary | None
    estimation_error: Summary | None  # [m]
    scores: Scores


@dataclass(frozen=True)
class Switch:
    """What the evaluations gained after the switch, and what `dense` gained over the same episodes."""

    name: str
    task: str
    misalignment_kind: str
    misalignment_deg: float
    before: Summary
    after: Summary
    change: Summary
    control: Summary | None


@dataclass(frozen=True)
class Comparison:
    """A number of the paper and the group it may be compared with, if there is one."""

    paper: PaperResult
    group: Group | None


class Statistics:
    """Summaries under one configuration; each quantity draws from the same seed, so that no order matters."""

    def __init__(self, config: AnalyzeConfig) -> None:
        self._config = config

    def of(self, values: Iterable[float | None]) -> Summary | None:
        """Summary of the values that are there."""
        array = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
        rng = np.random.default_rng(self._config.seed)
        return summarise(array, rng, self._config.bootstrap_samples, self._config.confidence)

    def paired(
        self, a: BySeed, b: BySeed, statistic: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[int, float, float | None, float | None] | None:
        """Number of common seeds, `statistic` of the two means, and its interval; None without a common seed.

        Both sides are resampled by the same seeds, which the schemes share. One seed has no interval.
        """
        seeds = sorted(set(a) & set(b))
        if not seeds:
            return None
        x, y = (np.array([side[seed] for seed in seeds]) for side in (a, b))  # (n,)
        value = float(statistic(x.mean(), y.mean()))
        if len(seeds) == 1:
            return 1, value, None, None
        rng = np.random.default_rng(self._config.seed)
        low, high = paired_interval(x, y, rng, self._config.bootstrap_samples, self._config.confidence, statistic)
        return len(seeds), value, low, high


def groups(runs: Sequence[Row], outcomes: Sequence[Row], areas: Sequence[Row], statistics: Statistics) -> list[Group]:
    """One group for every setting that any of `runs` has, also where nothing has been evaluated yet.

    `runs`, `outcomes` and `areas` are answers: identity and status of each run, where it ended, how fast it learnt.
    """
    ends = {row["run"]: row for row in outcomes if row["split"] is not None}
    curves = {row["run"]: row for row in areas}
    members: dict[tuple[Any, ...], list[Row]] = {}
    for run in runs:
        members.setdefault(tuple(run[key] for key in _KEY), []).append(run)
    made = [_group(key, cells, ends, curves, statistics) for key, cells in members.items()]
    return sorted(made, key=order)


def _group(
    key: tuple[Any, ...], cells: list[Row], ends: dict[str, Row], curves: dict[str, Row], statistics: Statistics
) -> Group:
    name, task, kind, degrees, scheme = key
    rows = [ends[cell["run"]] for cell in cells if cell["run"] in ends]
    learnt = [curves[cell["run"]] for cell in cells if cell["run"] in curves]
    statuses = [cell["status"] for cell in cells]
    failed = [cell["seed"] for cell in cells if cell["status"] == "failed" and cell["seed"] is not None]
    return Group(
        name=str(name),
        task=str(task),
        misalignment_kind=str(kind),
        misalignment_deg=float(degrees or 0.0),
        scheme=str(scheme),
        treatment=_treatment(cells) if scheme == "dense2sparse" else None,
        seeds=tuple(sorted(int(row["seed"]) for row in rows)),
        failed=statuses.count("failed"),
        failed_seeds=tuple(sorted(failed)),
        running=statuses.count("running"),
        judged_by=", ".join(sorted({row["split"] for row in rows})),
        episodes=min((row["episodes"] or 0 for row in rows), default=0),
        returns=statistics.of(row["mean_return"] for row in rows),
        success=statistics.of(row["success_rate"] for row in rows),
        steps_to_success=statistics.of(row["mean_steps_to_success"] for row in rows),
        estimation_error=statistics.of(row["mean_estimation_error"] for row in rows),
        scores=Scores(_by_seed(rows, "mean_return"), _by_seed(rows, "success_rate"), _by_seed(learnt, "area")),
    )


def _treatment(cells: Sequence[Row]) -> str | None:
    found = {f"{cell['buffer']}, {cell['reset']}" for cell in cells if cell["buffer"] and cell["reset"]}
    return " or ".join(sorted(found)) or None


def _by_seed(rows: Sequence[Row], column: str) -> BySeed:
    return {int(row["seed"]): float(row[column]) for row in rows if row[column] is not None and isfinite(row[column])}


def switches(rows: Sequence[Row], statistics: Statistics) -> list[Switch]:
    """Effect of the switch for every setting that has dense2sparse runs on both sides of it."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in _KEY[:-1]), []).append(row)
    made = [_switch(key, members, statistics) for key, members in found.items()]
    return sorted((switch for switch in made if switch is not None), key=order)


def _switch(key: tuple[Any, ...], rows: list[Row], statistics: Statistics) -> Switch | None:
    mine = [row for row in rows if row["scheme"] == "dense2sparse"]
    before = statistics.of(row["before_return"] for row in mine)
    after = statistics.of(row["after_return"] for row in mine)
    change = statistics.of(row["change"] for row in mine)
    if before is None or after is None or change is None:
        return None
    control = statistics.of(row["change"] for row in rows if row["scheme"] == "dense")
    name, task, kind, degrees = key
    return Switch(name, task, kind, degrees, before, after, change, control)


def beside_paper(found: Sequence[Group]) -> list[Comparison]:
    """Every number of the paper with each group of the same task, scheme and angle; one with None where none ran."""
    rows: list[Comparison] = []
    for paper in RESULTS:
        matches = [group for group in found if _same_setting(paper, group)]
        rows.extend(Comparison(paper, group) for group in matches)
        if not matches:
            rows.append(Comparison(paper, None))
    return rows


def _same_setting(paper: PaperResult, group: Group) -> bool:
    same = (paper.task, paper.scheme) == (group.task, group.scheme)
    return same and abs(paper.misalignment_deg - group.misalignment_deg) < 1e-3


def order(item: Group | Switch) -> tuple[Any, ...]:
    """Sort key: reach before lift, little misalignment before much, schemes in the order of `SCHEMES`."""
    scheme = getattr(item, "scheme", "")
    rank = SCHEMES.index(scheme) if scheme in SCHEMES else len(SCHEMES)
    return (item.name, item.task != "reach", item.task, item.misalignment_kind, item.misalignment_deg, rank)


def misalignment(kind: str, degrees: float) -> str:
    """`0°`, `orbit 5°`: at 0° the kind makes no difference."""
    return "0°" if not degrees or kind == "none" else f"{kind} {degrees:g}°"


def flat(found: Sequence[Group]) -> list[Row]:
    """The groups as rows of a table, summaries spread over columns."""
    return [flat_group(group) for group in found]


def flat_group(group: Group) -> Row:
    """One group as a row."""
    row: Row = {key: getattr(group, key) for key in _KEY}
    row |= {"treatment": group.treatment, "seeds": len(group.seeds), "failed": group.failed, "running": group.running}
    row |= {"judged_by": group.judged_by, "episodes": group.episodes}
    for quantity in ("returns", "success", "steps_to_success", "estimation_error"):
        summary: Summary | None = getattr(group, quantity)
        for part in ("mean", "std", "iqm", "low", "high"):
            row[f"{quantity.removesuffix('s') if quantity == 'returns' else quantity}_{part}"] = (
                None if summary is None else getattr(summary, part)
            )
    return row
