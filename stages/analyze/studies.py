"""Small studies beside the main matrix: one or two settings vary, everything else stays as it is there."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from schemas.config import flatten
from stages.analyze.results import Group, Row, flat_group, groups, order
from stages.analyze.statistics import Statistics


@dataclass(frozen=True)
class Study:
    """Runs that differ from the main matrix in a few settings."""

    name: str
    question: str
    keys: tuple[str, ...]
    """What varies, as dotted keys of a run's configuration: `policy.switch_episode`, `world.touch`."""
    runs: tuple[str, ...]
    """NAMEs of its variants' runs."""
    main: str
    """NAME of the matrix whose cells of the same task, scheme, angle and seed are the reference."""


_KEPT = ("policy.checkpoint_every", "policy.log_updates_every", "policy.record_every")
_NO_DIFFERENCE = ("run.", "policy.final_episodes", *_KEPT)
"""Identity, the precision of the final evaluation, and what is kept on disk: nothing of how a run learns."""


@dataclass(frozen=True)
class Variant:
    """The runs of one study with the same values, or the main runs beside them, in one setting."""

    study: str
    values: tuple[tuple[str, str], ...]  # what varies and its value, as text: ("policy.buffer", "keep")
    main: bool
    also_differs: str  # keys in which the runs differ from the main ones besides, with both values
    group: Group

    @property
    def settings(self) -> str:
        """`policy.buffer = keep; policy.reset = none`."""
        return "; ".join(f"{key} = {value}" for key, value in self.values)

    @property
    def label(self) -> str:
        """The values alone."""
        return ", ".join(value for _, value in self.values)

    @property
    def said(self) -> str:
        """The settings without their sections: `buffer = keep, reset = none`."""
        return ", ".join(f"{key.partition('.')[2]} = {value}" for key, value in self.values)


def variants(rows: Sequence[Row], studies: Sequence[Study], statistics: Statistics) -> list[Variant]:
    """Every variant of every study, those of a setting together, the main runs first; `rows` are study-outcomes."""
    found = []
    for study in studies:
        mine = [row | _treatment(row) for row in rows if row["study"] == study.name]
        for group in groups(mine, mine, [], statistics):
            members = [row for row in mine if row["run"].split("/")[0] == group.name and _is_of(row, group)]
            references = [row for row in mine if row["main"] and _is_of(row, group)]
            also = "" if members[0]["main"] else _also_differs(members, references, study.keys)
            found.append(Variant(study.name, _values(members, study.keys), members[0]["main"], also, group))
    positions = {(study.name, run): (i, j) for i, study in enumerate(studies) for j, run in enumerate(study.runs)}
    places = {study.name: (i, -1) for i, study in enumerate(studies)}  # of the main runs

    def place(each: Variant) -> tuple[Any, ...]:
        study, position = positions.get((each.study, each.group.name), places[each.study])
        return study, order(each.group)[1:], position

    return sorted(found, key=place)


def _values(members: Sequence[Row], keys: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """What the members have of `keys`; several values of one key where they differ in it."""
    configs = [dict(flatten(json.loads(row["config"]))) for row in members]
    return tuple((key, " or ".join(dict.fromkeys(_text(config.get(key)) for config in configs))) for key in keys)


def _text(value: Any) -> str:
    return "–" if value is None else value if isinstance(value, str) else json.dumps(value)


def _treatment(row: Row) -> Row:
    policy = json.loads(row["config"]).get("policy", {})
    return {key: policy.get(key) for key in ("buffer", "reset", "reset_updates")}


def _is_of(row: Row, group: Group) -> bool:
    keys = ("task", "misalignment_kind", "misalignment_deg", "scheme")
    return all(row[key] == getattr(group, key) for key in keys)


def _also_differs(members: Sequence[Row], references: Sequence[Row], keys: Sequence[str]) -> str:
    """Differences to the main runs that are none of the study's keys."""
    if not references:
        return ""
    mine = [dict(flatten(json.loads(row["config"]))) for row in members]
    theirs = [dict(flatten(json.loads(row["config"]))) for row in references]
    names = dict.fromkeys(key for config in [*mine, *theirs] for key in config)
    differing = []
    for key in names:
        if key in keys or key.startswith(_NO_DIFFERENCE):
            continue
        here, there = ({json.dumps(config.get(key)) for config in side} for side in (mine, theirs))
        if here != there:
            differing.append(f"{key} = {' or '.join(sorted(here))} (main: {' or '.join(sorted(there))})")
    return "; ".join(differing)


def flat(found: Sequence[Variant]) -> list[Row]:
    """The variants as rows of a table."""
    return [
        {"study": each.study, "settings": each.settings, "main": each.main}
        | flat_group(each.group)
        | {"also_differs": each.also_differs}
        for each in found
    ]
