"""Runs gathered into groups that differ in nothing but the seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Protocol

from stages.analyze.statistics import BySeed, Statistics, Summary

SCHEMES = ("oracle", "dense2sparse", "dense", "sparse")
"""In the order of every table and legend: first the one that knows the truth, then the paper's, then its rivals."""
LEARN_FROM_ESTIMATES = ("dense2sparse", "dense")
"""Schemes that act on estimates and are trained by rewards from them."""

Row = dict[str, Any]
IDENTITY = ("name", "task", "misalignment_kind", "misalignment_deg", "scheme")


@dataclass(frozen=True)
class Answer:
    """A question and its rows."""

    sql: str
    rows: list[Row]


def schemes_of(rows: Sequence[Row]) -> list[str]:
    """Schemes that the rows name, in the order of `SCHEMES`."""
    present = {row["scheme"] for row in rows}
    return [scheme for scheme in SCHEMES if scheme in present]


def rows_of(answers: Mapping[str, Answer], name: str) -> list[Row]:
    """The rows of an answer; none where the question was not asked."""
    return answers[name].rows if name in answers else []


def total(answers: Mapping[str, Answer], name: str, column: str) -> int:
    """Sum of a column of an answer of counts."""
    return sum(row[column] or 0 for row in rows_of(answers, name))


@dataclass(frozen=True)
class Scores:
    """What each seed of a group reached."""

    returns: BySeed
    success: BySeed
    area: BySeed  # under the learning curve, over its length and its own final return: 1 is learnt at once


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

    def counted(self, scores: BySeed) -> BySeed:
        """`scores` of this group with its failed seeds as 0."""
        return dict.fromkeys(self.failed_seeds, 0.0) | dict(scores)


def groups(runs: Sequence[Row], outcomes: Sequence[Row], areas: Sequence[Row], statistics: Statistics) -> list[Group]:
    """One group for every setting that any of `runs` has, also where nothing has been evaluated yet.

    `runs`, `outcomes` and `areas` are answers: identity and status of each run, where it ended, how fast it learnt.
    """
    ends = {row["run"]: row for row in outcomes if row["split"] is not None}
    curves = {row["run"]: row for row in areas}
    members: dict[tuple[Any, ...], list[Row]] = {}
    for run in runs:
        members.setdefault(tuple(run[key] for key in IDENTITY), []).append(run)
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
    returns, success = _by_seed(rows, "mean_return"), _by_seed(rows, "success_rate")
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
        scores=Scores(returns, success, _shares(_by_seed(learnt, "area"), returns, success)),
    )


def _treatment(cells: Sequence[Row]) -> str | None:
    found = {_treated(cell) for cell in cells if cell["buffer"] and cell["reset"]}
    return " or ".join(sorted(found)) or None


def _treated(cell: Row) -> str:
    updates = cell.get("reset_updates")
    return f"{cell['buffer']}, {cell['reset']}" + (f" caught up by {updates} updates" if updates else "")


def _shares(areas: BySeed, returns: BySeed, success: BySeed) -> BySeed:
    """Of the level that each seed ended at, so that how fast it learnt is not mixed with how far it got.

    A seed that never succeeds has learnt nothing, at no speed.
    """
    learnt = [seed for seed in areas if returns.get(seed, 0.0) > 0 and success.get(seed, 0.0) > 0]
    return {seed: areas[seed] / returns[seed] for seed in learnt}


def _by_seed(rows: Sequence[Row], column: str) -> BySeed:
    return {int(row["seed"]): float(row[column]) for row in rows if row[column] is not None and isfinite(row[column])}


class Placed(Protocol):
    """What belongs to a setting: a group, or the switch of one."""

    @property
    def name(self) -> str: ...
    @property
    def task(self) -> str: ...
    @property
    def misalignment_kind(self) -> str: ...
    @property
    def misalignment_deg(self) -> float: ...


def order(item: Placed) -> tuple[Any, ...]:
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
    row: Row = {key: getattr(group, key) for key in IDENTITY}
    row |= {"treatment": group.treatment, "seeds": len(group.seeds), "failed": group.failed, "running": group.running}
    row |= {"judged_by": group.judged_by, "episodes": group.episodes}
    for quantity in ("returns", "success", "steps_to_success", "estimation_error"):
        summary: Summary | None = getattr(group, quantity)
        for part in ("mean", "std", "iqm", "iqm_low", "iqm_high", "low", "high"):
            row[f"{quantity.removesuffix('s') if quantity == 'returns' else quantity}_{part}"] = (
                None if summary is None else getattr(summary, part)
            )
    return row
