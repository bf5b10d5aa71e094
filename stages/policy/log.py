"""The Parquet logs of one run (SPEC §5): transitions in parts, episodes, evaluations, updates."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas import tables
from schemas.errors import ArtifactError
from schemas.files import write_parquet
from stages.policy.config import RunSpec

_TABLES = {"episodes": tables.EPISODES, "evaluations": tables.EVALUATIONS, "updates": tables.UPDATES}


@dataclass(frozen=True)
class EpisodeHead:
    """What all rows of an episode share."""

    split: str
    episode: int
    global_step: int  # training steps taken before the episode
    phase: str


class RunLog:
    """Collects whole episodes in memory and writes them at `flush`, each file whole or absent."""

    def __init__(self, spec: RunSpec, observation_dim: int, action_dim: int) -> None:
        self._out = spec.out
        self._schema = tables.transitions(observation_dim, action_dim)
        self._identity = {
            "run": spec.run_id,
            "task": spec.task,
            "scheme": spec.scheme,
            "misalignment_kind": spec.misalignment_kind,
            "misalignment_deg": spec.misalignment_deg,
            "seed": spec.seed,
        }
        self._pending: list[pa.Table] = []
        self._parts = 0
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in _TABLES}
        (self._out / "transitions").mkdir(exist_ok=True)

    def add_transitions(self, head: EpisodeHead, columns: dict[str, np.ndarray]) -> None:
        """One episode's transitions; `columns` as `EpisodeColumns.of_run` gives them."""
        self._pending.append(_transitions_table(self._schema, self._identity, head, columns))

    def add(self, table: str, row: dict[str, Any]) -> None:
        """A row of `episodes`, `evaluations` or `updates`, without the run's identity."""
        self._rows[table].append(row)

    def rows(self, table: str) -> list[dict[str, Any]]:
        """Rows of a table so far."""
        return self._rows[table]

    def flush(self) -> None:
        """Write what was added."""
        if self._pending:
            write_parquet(pa.concat_tables(self._pending), self._part(self._parts))
            self._pending, self._parts = [], self._parts + 1
        for name, schema in _TABLES.items():
            write_parquet(self._table(name, schema), self._out / f"{name}.parquet")

    def counts(self) -> dict[str, int]:
        """How much is on disk, for a checkpoint to remember."""
        return {"parts": self._parts, **{name: len(rows) for name, rows in self._rows.items()}}

    def restore(self, counts: dict[str, int]) -> None:
        """Go back to what a checkpoint remembered: anything later is written again by the resumed run.

        Raises:
            ArtifactError: less is on disk than the checkpoint remembers.
        """
        for path in sorted((self._out / "transitions").glob("part-*.parquet"))[counts["parts"] :]:
            path.unlink()
        self._parts = counts["parts"]
        for name in _TABLES:
            path = self._out / f"{name}.parquet"
            rows = _read(path).drop_columns(list(self._identity)).to_pylist() if counts[name] else []
            if len(rows) < counts[name]:
                raise ArtifactError(f"{path} has {len(rows)} rows, its checkpoint {counts[name]}: the run is damaged")
            self._rows[name] = rows[: counts[name]]

    def training_transitions(self) -> dict[str, np.ndarray]:
        """The training rows on disk, in order: the source of the replay buffer on resume."""
        columns = ["observation", "action", "reward_used", "reward_sparse", "next_observation", "terminated", "episode"]
        parts = [_read(self._part(part)) for part in range(self._parts)]
        table = pa.concat_tables(parts) if parts else self._schema.empty_table()
        table = table.filter(pa.compute.equal(table["split"].cast(pa.string()), "train")).select(columns)
        return {name: _to_numpy(table[name]) for name in columns}

    def _part(self, index: int) -> Path:
        return self._out / "transitions" / f"part-{index:05d}.parquet"

    def _table(self, name: str, schema: pa.Schema) -> pa.Table:
        return pa.Table.from_pylist([self._identity | row for row in self._rows[name]], schema=schema)


def _transitions_table(
    schema: pa.Schema, identity: dict[str, Any], head: EpisodeHead, columns: dict[str, np.ndarray]
) -> pa.Table:
    steps = len(columns["time_ns"])
    training = head.split == "train"
    constants = identity | {"split": head.split, "episode": head.episode, "phase": head.phase, "terminated": False}
    numbers = np.arange(steps)
    varying = columns | {
        "step": numbers,
        "global_step": head.global_step + (numbers if training else np.zeros(steps, np.int64)),
        "truncated": numbers == steps - 1,
    }
    for name in ("eef", "cube_true", "cube_est"):
        varying |= {f"{name}_{axis}": columns[name][:, i] for i, axis in enumerate("xyz")}
    arrays = [
        _constant(field.type, constants[field.name], steps)
        if field.name in constants
        else _array(field.type, varying[field.name])
        for field in schema
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def _constant(kind: pa.DataType, value: Any, length: int) -> pa.Array:
    if pa.types.is_dictionary(kind):
        return pa.DictionaryArray.from_arrays(pa.array(np.zeros(length, np.int32)), pa.array([value]))
    return pa.array(np.full(length, value), type=kind)


def _array(kind: pa.DataType, values: np.ndarray) -> pa.Array:
    """NaN, which only a missing estimate gives, becomes null."""
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel(), type=kind.value_type), type=kind)
    if pa.types.is_floating(kind):
        return pa.array(values.astype(kind.to_pandas_dtype()), type=kind, from_pandas=True)
    return pa.array(values.astype(kind.to_pandas_dtype()), type=kind)


def _to_numpy(column: pa.ChunkedArray) -> np.ndarray:
    combined = column.combine_chunks()
    if pa.types.is_fixed_size_list(column.type):
        flat = combined.flatten().to_numpy(zero_copy_only=False)
        return flat.reshape(-1, column.type.list_size)
    return combined.to_numpy(zero_copy_only=False)


def _read(path: Path) -> pa.Table:
    try:
        return pq.read_table(path, partitioning=None)
    except (OSError, pa.ArrowInvalid) as error:
        raise ArtifactError(
            f"{path} cannot be read ({error}); the run is damaged: remove it and train again"
        ) from error
