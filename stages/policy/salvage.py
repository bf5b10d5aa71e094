"""What is left of a damaged run: its log up to the last whole episode, and the checkpoints that fit it."""

import shutil
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from schemas import tables
from schemas.errors import ArtifactError
from schemas.files import failure_path, read_parquet, transition_parts, write_parquet
from stages.policy import checkpoint
from stages.policy.log import LOGS
from stages.policy.ownership import episodes_of, require_own
from stages.policy.parts import Parts

_TRANSITIONS = tables.transitions(1, 1)  # the same columns, whatever the lengths of its lists


@dataclass(frozen=True)
class Whole:
    """What of a run is whole, as `assess` finds it."""

    logs: dict[str, pa.Table]  # episodes, evaluations and updates up to the last whole episode
    parts: tuple[Path, ...]  # of transitions, before the first that is damaged or missing
    checkpoints: tuple[str, ...]  # names of those that a resumed run can go on from
    kept: str  # in words
    lost: tuple[str, ...]  # in words; empty: nothing is


def assess(run: Path, identity: Mapping[str, Any], damaged: Collection[str], from_logs: bool = False) -> Whole:
    """What is whole in `run`, of which the files `damaged` (relative to it) are known not to be what was written.

    What is not of the run that `identity` tells is damaged, too. A damaged part of the transitions counts for nothing,
    even before the page whose checksum fails: the headers of pages have none, and a damaged one shifts the rows of its
    column. A run that learns `from_logs` has no training episodes: its updates are whole without. Parquet files are
    read, and their checksums verified; so is what seals a checkpoint.
    """
    logs = {name: _table(run, f"{name}.parquet", schema, identity, damaged) for name, schema in LOGS.items()}
    episodes = _of(logs, "episodes")
    expected = episodes_of(episodes)
    lost: list[str] = []
    parts, rows, held = [], 0, 0
    for number, path in enumerate(transition_parts(run)):
        found = _table(run, f"transitions/part-{number:05d}.parquet", _TRANSITIONS, identity, damaged)
        there = [] if found is None else episodes_of(found.filter(pa.compute.equal(found["step"], 0)))
        told = expected[held : held + len(there)]  # fewer where it was killed before the episodes were told of
        if found is None or there[: len(told)] != told:
            lost.append(f"transitions from {path.name} on")
            break
        parts.append(path)
        rows, held = rows + found.num_rows, held + len(there)
    lost += [f"{name}.parquet" for name, table in logs.items() if table is None]
    kept = episodes.slice(0, int(np.searchsorted(np.cumsum(episodes["length"].to_numpy()), rows, side="right")))
    if kept.num_rows < episodes.num_rows:
        lost.append(f"{episodes.num_rows - kept.num_rows} of {episodes.num_rows} episodes")
    whole = {"episodes": kept, "evaluations": _evaluated(_of(logs, "evaluations"), kept)}
    whole["updates"] = _of(logs, "updates") if from_logs else _learnt(_of(logs, "updates"), kept)
    for name in ("evaluations", "updates"):
        if (rows := whole[name].num_rows) < (there := _of(logs, name).num_rows):
            lost.append(f"{there - rows} of {there} rows of {name}")
    points = {point.name: checkpoint.counts(run, str(identity["run"]), point) for point in checkpoint.available(run)}
    usable = [name for name, counts in points.items() if counts is not None and _holds(whole, counts)]
    lost += [f"checkpoint {name}" for name in points if name not in usable]
    if lost and (run / checkpoint.DESCRIPTION).exists():
        lost.append("that the run has ended (its policy stays until it is trained anew)")
    return Whole(whole, tuple(parts), tuple(usable), _in_words(kept), tuple(lost))


def cut(run: Path, whole: Whole) -> None:
    """Leave what is whole, for `--resume` to go on from. The policy is taken back: the run it ended is not whole."""
    for path in reversed(transition_parts(run)):
        if path not in whole.parts:
            path.unlink()
    for name, table in whole.logs.items():
        write_parquet(table, run / f"{name}.parquet")
    if whole.parts:
        schema = _transitions_schema(whole.parts[0])
        Parts(run, schema).keep(int(sum(whole.logs["episodes"]["length"].to_pylist())))
    for point in checkpoint.available(run):
        if point.name not in whole.checkpoints:
            shutil.rmtree(run / "checkpoints" / point.name)
    checkpoint.unpublish(run)
    shutil.rmtree(failure_path(run), ignore_errors=True)


def _table(
    run: Path, name: str, schema: pa.Schema, identity: Mapping[str, Any], damaged: Collection[str]
) -> pa.Table | None:
    if name in damaged:
        return None
    try:
        table = read_parquet(run / name)
        require_own(table, schema.names, identity, run / name)
    except ArtifactError:
        return None
    return table


def _of(logs: dict[str, pa.Table | None], name: str) -> pa.Table:
    found = logs[name]
    return LOGS[name].empty_table() if found is None else found


def _evaluated(evaluations: pa.Table, episodes: pa.Table) -> pa.Table:
    """Evaluations whose episodes are all there."""
    there, needed, count = _per_split(episodes), Counter[str](), 0
    for row in evaluations.select(["split", "episodes"]).to_pylist():
        needed[row["split"]] += row["episodes"]
        if needed[row["split"]] > there.get(row["split"], 0):
            break
        count += 1
    return evaluations.slice(0, count)


def _learnt(updates: pa.Table, episodes: pa.Table) -> pa.Table:
    """Updates of training episodes that are there."""
    later = np.flatnonzero(updates["episode"].to_numpy() >= _per_split(episodes).get("train", 0))
    return updates.slice(0, int(later[0]) if len(later) else updates.num_rows)


def _per_split(episodes: pa.Table) -> dict[str, int]:
    splits, counts = np.unique(np.array(episodes["split"].to_pylist(), dtype=str), return_counts=True)
    return dict(zip(splits.tolist(), counts.tolist(), strict=True))


def _holds(logs: dict[str, pa.Table], counts: dict[str, int]) -> bool:
    return all(table.num_rows >= counts.get(name, 0) for name, table in logs.items())


def _in_words(episodes: pa.Table) -> str:
    counts = ", ".join(f"{count} of {split}" for split, count in _per_split(episodes).items())
    return f"{episodes.num_rows} episodes" + (f" ({counts})" if counts else "")


def _transitions_schema(part: Path) -> pa.Schema:
    found = read_parquet(part, ["observation", "action"]).schema
    return tables.transitions(*(found.field(name).type.list_size for name in ("observation", "action")))
