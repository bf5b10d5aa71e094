"""The Parquet logs of one run (SPEC §5): transitions in parts, episodes, evaluations, updates."""

import shutil
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from schemas import tables
from schemas.arrays import constant, to_arrow, to_numpy
from schemas.errors import ArtifactError
from schemas.files import failure_path, transition_parts, write_parquet
from stages.policy.config import RunSpec
from stages.policy.growing import Growing
from stages.policy.ownership import own_episodes
from stages.policy.parts import Parts

LOGS = {"episodes": tables.EPISODES, "evaluations": tables.EVALUATIONS, "updates": tables.UPDATES}


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
        self._identity = spec.identity
        self._pending: list[tuple[EpisodeHead, dict[str, np.ndarray]]] = []
        self._parts = Parts(spec.out, self._schema)
        self._tables = {
            name: Growing(self._out / f"{name}.parquet", schema, self._identity) for name, schema in LOGS.items()
        }

    def add_transitions(self, head: EpisodeHead, columns: dict[str, np.ndarray]) -> None:
        """One episode's transitions; `columns` as `EpisodeColumns.of_run` gives them."""
        self._pending.append((head, columns))

    def add(self, table: str, row: dict[str, Any]) -> None:
        """A row of `episodes`, `evaluations` or `updates`, without the run's identity."""
        self._tables[table].add(row)

    def rows(self, table: str) -> list[dict[str, Any]]:
        """Rows of a table so far, without the run's identity and what is a list."""
        return self._tables[table].rows()

    def keep_failure(self, head: EpisodeHead, columns: dict[str, np.ndarray], row: dict[str, Any]) -> None:
        """Write the episode in which the run failed, up to where it did, beside the logs: it is no data of theirs.

        `columns` and `row` as of an episode that is logged.
        """
        out = failure_path(self._out)
        shutil.rmtree(out, ignore_errors=True)
        (out / "transitions").mkdir(parents=True)
        table = _transitions_table(self._schema, self._identity, [(head, columns)])
        write_parquet(table, out / "transitions" / "part-00000.parquet")
        episodes = pa.Table.from_pylist([self._identity | row], schema=tables.EPISODES)
        write_parquet(episodes, out / "episodes.parquet")

    def flush(self) -> None:
        """Write what was added since the last time, transitions first: no episode is told of that has none."""
        if self._pending:
            self._parts.append(_transitions_table(self._schema, self._identity, self._pending))
            self._pending = []
        for table in self._tables.values():
            table.flush()

    def counts(self) -> dict[str, int]:
        """How much is on disk, for a checkpoint to remember."""
        return {name: len(table) for name, table in self._tables.items()}

    def restore(self, counts: dict[str, int]) -> None:
        """Go back to what a checkpoint remembered: anything later is written again by the resumed run.

        Raises:
            ArtifactError: less is on disk than the checkpoint remembers, or something else.
        """
        shutil.rmtree(failure_path(self._out), ignore_errors=True)  # it goes on from before that
        for name, table in self._tables.items():
            table.keep(counts[name])
        self._parts.keep(sum(row["length"] for row in self.rows("episodes")))
        self._require_own_transitions()

    def _require_own_transitions(self) -> None:
        """The transitions are this run's, in the order of its episodes: the replay buffer is filled from them."""
        held = [each for path in transition_parts(self._out) for each in own_episodes(path, self._identity)]
        if held != [(row["split"], row["episode"]) for row in self.rows("episodes")]:
            raise ArtifactError(f"{self._out / 'transitions'} holds other episodes than it did: see `pipeline repair`")

    def training_transitions(self) -> dict[str, np.ndarray]:
        """The training rows on disk, in order: the source of the replay buffer on resume."""
        columns = ["observation", "action", "reward_used", "reward_sparse", "next_observation", "terminated", "episode"]
        table = pa.concat_tables([self._schema.empty_table(), *self._parts.read()])
        table = table.filter(pa.compute.equal(table["split"].cast(pa.string()), "train")).select(columns)
        return {name: to_numpy(table[name]) for name in columns}


def _transitions_table(
    schema: pa.Schema, identity: dict[str, Any], episodes: list[tuple[EpisodeHead, dict[str, np.ndarray]]]
) -> pa.Table:
    """Whole episodes, one after the other."""
    heads = [head for head, _ in episodes]
    lengths = np.array([len(columns["time_ns"]) for _, columns in episodes])
    steps = np.concatenate([np.arange(length) for length in lengths])
    total = len(steps)
    joined = {name: np.concatenate([columns[name] for _, columns in episodes]) for name in episodes[0][1]}
    for name in ("eef", "cube_true", "cube_est"):
        joined |= {f"{name}_{axis}": joined[name][:, i] for i, axis in enumerate("xyz")}
    before = np.repeat([head.global_step for head in heads], lengths)
    training = np.repeat([head.split == "train" for head in heads], lengths)
    joined |= {
        "episode": np.repeat([head.episode for head in heads], lengths),
        "step": steps,
        "global_step": before + np.where(training, steps, 0),
        "terminated": np.zeros(total, bool),
        "truncated": steps == np.repeat(lengths, lengths) - 1,
    }
    words = {name: [getattr(head, name) for head in heads] for name in ("split", "phase")}
    arrays = []
    for field in schema:
        if field.name in identity:
            arrays.append(constant(field.type, identity[field.name], total))
        elif field.name in words:
            arrays.append(_words(words[field.name], lengths))
        else:
            arrays.append(to_arrow(field.type, joined[field.name]))
    return pa.Table.from_arrays(arrays, schema=schema)


def _words(values: list[str], lengths: np.ndarray) -> pa.Array:
    """The word of each episode, repeated over its rows."""
    known = list(dict.fromkeys(values))
    codes = np.array([known.index(value) for value in values], np.int32)
    return pa.DictionaryArray.from_arrays(pa.array(np.repeat(codes, lengths), pa.int32()), pa.array(known))
