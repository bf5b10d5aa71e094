"""Small studies beside the main matrix: one or two settings vary, everything else stays as it is there."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from stages.analyze.formats import signed
from stages.analyze.results import Group, Row, Statistics, flat_group, groups, misalignment, order


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


_NO_DIFFERENCE = ("run.", "policy.final_episodes", "policy.checkpoint_every", "policy.log_updates_every")
"""Identity, the precision of the final evaluation, and what is kept on disk: nothing of how a run learns."""
TREATMENT = ("policy.buffer", "policy.reset")
"""Keys of what becomes of replay buffer and networks at the switch, on which the paper is silent."""


@dataclass(frozen=True)
class Variant:
    """The runs of one study with the same values, or the main runs beside them, in one setting."""

    study: str
    settings: str  # `policy.buffer = keep; policy.reset = none`
    main: bool
    also_differs: str  # keys in which the runs differ from the main ones besides, with both values
    group: Group

    @property
    def label(self) -> str:
        """The values alone."""
        return ", ".join(part.split(" = ", 1)[1] for part in self.settings.split("; "))

    @property
    def said(self) -> str:
        """The settings without their sections: `buffer = keep, reset = none`."""
        return ", ".join(part.split(".", 1)[1] for part in self.settings.split("; "))


def variants(rows: Sequence[Row], studies: Sequence[Study], statistics: Statistics) -> list[Variant]:
    """Every variant of every study, those of a setting together, the main runs first; `rows` are study-outcomes."""
    found = []
    for study in studies:
        mine = [row | _treatment(row) for row in rows if row["study"] == study.name]
        for group in groups(mine, mine, [], statistics):
            members = [row for row in mine if row["run"].split("/")[0] == group.name and _is_of(row, group)]
            references = [row for row in mine if row["main"] and _is_of(row, group)]
            settings = " or ".join(dict.fromkeys(row["settings"] for row in members))
            also = "" if members[0]["main"] else _also_differs(members, references, study.keys)
            found.append(Variant(study.name, settings, members[0]["main"], also, group))
    positions = {(study.name, run): (i, j) for i, study in enumerate(studies) for j, run in enumerate(study.runs)}
    places = {study.name: (i, -1) for i, study in enumerate(studies)}  # of the main runs

    def place(each: Variant) -> tuple[Any, ...]:
        study, position = positions.get((each.study, each.group.name), places[each.study])
        return study, order(each.group)[1:], position

    return sorted(found, key=place)


def _treatment(row: Row) -> Row:
    policy = json.loads(row["config"]).get("policy", {})
    return {key: policy.get(key) for key in ("buffer", "reset")}


def _is_of(row: Row, group: Group) -> bool:
    keys = ("task", "misalignment_kind", "misalignment_deg", "scheme")
    return all(row[key] == getattr(group, key) for key in keys)


def _also_differs(members: Sequence[Row], references: Sequence[Row], keys: Sequence[str]) -> str:
    """Differences to the main runs that are none of the study's keys."""
    if not references:
        return ""
    mine = [dict(leaves(json.loads(row["config"]))) for row in members]
    theirs = [dict(leaves(json.loads(row["config"]))) for row in references]
    names = dict.fromkeys(key for config in [*mine, *theirs] for key in config)
    differing = []
    for key in names:
        if key in keys or key.startswith(_NO_DIFFERENCE):
            continue
        here, there = ({json.dumps(config.get(key)) for config in side} for side in (mine, theirs))
        if here != there:
            differing.append(f"{key} = {' or '.join(sorted(here))} (main: {' or '.join(sorted(there))})")
    return "; ".join(differing)


def leaves(config: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested sections."""
    for key, value in config.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def best_treatments(found: Sequence[Variant], studies: Sequence[Study]) -> list[tuple[Study, list[Variant]]]:
    """For each main matrix and task the variant of dense2sparse with the best treatment, in every setting it ran in.

    Best: the highest mean return at the largest misalignment that any variant of the task ran at. Where that is the
    main runs' own treatment, there is nothing to show beside them.
    """
    treated = {study.name: study for study in studies if set(study.keys) & set(TREATMENT)}
    candidates = [v for v in found if v.study in treated and not v.main and v.group.scheme == "dense2sparse"]
    chosen = []
    for main, task in dict.fromkeys((treated[v.study].main, v.group.task) for v in candidates):
        mine = [v for v in candidates if (treated[v.study].main, v.group.task) == (main, task) and v.group.returns]
        if not mine:
            continue
        largest = max(v.group.misalignment_deg for v in mine)
        there = [v for v in mine if v.group.misalignment_deg == largest]
        best = max(there, key=lambda v: v.group.returns.mean if v.group.returns else -np.inf)
        if any(v.main and v.study == best.study and v.settings == best.settings for v in found):
            continue
        same = [v for v in mine if (v.study, v.group.name) == (best.study, best.group.name)]
        chosen.append((treated[best.study], same))
    return chosen


def flat(found: Sequence[Variant]) -> list[Row]:
    """The variants as rows of a table."""
    return [
        {"study": each.study, "settings": each.settings, "main": each.main}
        | flat_group(each.group)
        | {"also_differs": each.also_differs}
        for each in found
    ]


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
    judged = sorted(
        (v for v in members if v.group.returns and not v.main), key=lambda v: -asdict(v.group)["returns"]["mean"]
    )
    reference = next((v for v in members if v.main and v.group.returns), None)
    if not judged:
        return f"{where}: no variant has been evaluated."
    best = judged[0]
    said = f"{where}: highest of {_count(len(judged), 'variant')} is {best.said} with {_mean(best):.1f}"
    if reference is None:
        return f"{said}; there is no main run to compare it with."
    said += f"; the main runs ({reference.said}) end at {_mean(reference):.1f}"
    paired = statistics.paired(best.group.scores.returns, reference.group.scores.returns, np.subtract)
    if paired is None:
        return f"{said}, with no seed in common."
    seeds, difference, low, high = paired
    if low is None or high is None:
        return f"{said}: {signed(difference)} on the one seed in common, which says nothing about the spread."
    shown = "higher" if low > 0 else "lower" if high < 0 else "not shown to differ"
    return (
        f"{said}: {signed(difference)} ({confidence} interval {signed(low)} to {signed(high)}, {seeds} seeds), {shown}."
    )


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


def _mean(variant: Variant) -> float:
    return variant.group.returns.mean if variant.group.returns else np.nan
