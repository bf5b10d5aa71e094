"""Groups beside what they are measured by: the paper's numbers, and themselves before the switch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stages.analyze.paper import RESULTS, PaperResult
from stages.analyze.results import IDENTITY, Group, Row, order
from stages.analyze.statistics import Statistics, Summary


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


def switches(rows: Sequence[Row], statistics: Statistics) -> list[Switch]:
    """Effect of the switch for every setting that has dense2sparse runs on both sides of it."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in IDENTITY[:-1]), []).append(row)
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
