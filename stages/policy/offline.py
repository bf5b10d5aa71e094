"""Logged transitions as the only source of learning: no step in the world but to evaluate."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from schemas.arrays import to_numpy
from schemas.errors import ArtifactError
from schemas.files import read_parquet, transition_parts
from stages.policy.replay_buffer import ReplayBuffer

_COLUMNS = ("observation", "action", "reward_used", "reward_sparse", "next_observation", "terminated")


def count(sources: Sequence[Path]) -> int:
    """Training transitions that the sources hold.

    Raises:
        ArtifactError: one has none (a run that itself learnt from logs alone, say), or they are damaged.
    """
    found = [sum(_training(path, []).num_rows for path in _parts([source])) for source in sources]
    for source, rows in zip(sources, found, strict=True):
        if rows == 0:
            raise ArtifactError(f"{source} has no training transitions to learn from, only evaluations")
    return sum(found)


def fill(buffer: ReplayBuffer, row: int, sources: Sequence[Path]) -> None:
    """Put every training transition of the sources (directories of runs, or of their new labels) into a run's buffer.

    The reward is the one they were given: `reward_used`.

    Raises:
        ArtifactError: a source has no transitions, or they are damaged.
    """
    for path in _parts(sources):
        table = _training(path, list(_COLUMNS))
        buffer.add(row, *(to_numpy(table[name]) for name in _COLUMNS))


def _parts(sources: Sequence[Path]) -> list[Path]:
    found = []
    for source in sources:
        parts = transition_parts(source)
        if not parts:
            raise ArtifactError(f"{source} has no transitions/part-*.parquet to learn from")
        found += parts
    return found


def _training(path: Path, columns: list[str]) -> pa.Table:
    table = read_parquet(path, [*columns, "split"])
    return table.filter(pc.equal(table["split"].cast(pa.string()), "train"))
