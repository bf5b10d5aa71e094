"""One recorded episode of a run, read from its Parquet logs and checked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from schemas.arrays import to_numpy
from schemas.errors import ArtifactError
from schemas.files import failure_path, read_parquet, read_rows, reading, transition_parts
from schemas.manifest import Manifest, read_manifest
from schemas.tables import EPISODES, transitions
from stages.replay.parquet import check_schema


@dataclass(frozen=True)
class LoggedEpisode:
    """What the logs say of one episode. Row k is the step `k` and the state after its action."""

    run_dir: Path
    manifest: Manifest
    split: str
    episode: int
    rows: dict[str, np.ndarray]  # column → (n,) or (n, d); null is NaN, phases are strings
    summary: dict[str, Any]  # the episode's row of episodes.parquet
    initial_state: np.ndarray  # (k,) float64, MuJoCo integration state
    final_state: np.ndarray  # (k,) float64, the same after the last step
    reestimated: str | None = None  # by whom and from where the estimates were made again; None: they are the logged

    @property
    def steps(self) -> int:
        """Number of rows, n."""
        return len(self.rows["step"])

    @property
    def task(self) -> str:
        """reach or lift."""
        return str(self.manifest.config["run"]["task"])

    @property
    def run(self) -> str:
        """NAME/CELL."""
        return "/".join(self.run_dir.parts[-2:])

    def vector(self, name: str) -> np.ndarray:
        """Columns `name`_x, _y, _z as (n, 3)."""
        return np.stack([self.rows[f"{name}_{axis}"] for axis in "xyz"], axis=1)


def load_episode(run_dir: Path, split: str, episode: int | None) -> LoggedEpisode:
    """Read episode `episode` (counted from 0 within `split`) of the run in `run_dir`; None: the one in which it failed.

    Raises:
        ArtifactError: no such run or episode, or its logs are missing, truncated or of another schema.
    """
    manifest = read_manifest(run_dir)
    if manifest.stage != "train-policy":
        raise ArtifactError(f"{run_dir} is an artifact of {manifest.stage}, not a run")
    if episode is None:
        return _failure(run_dir, manifest)
    summary = _episode_summary(run_dir, split, episode)
    return episode_of(run_dir, manifest, _transitions(run_dir, split, episode), summary)


def _failure(run_dir: Path, manifest: Manifest) -> LoggedEpisode:
    """The episode in which a run failed, up to the step that made it fail."""
    kept = failure_path(run_dir)
    if not kept.is_dir():
        raise ArtifactError(f"{run_dir} did not fail in an episode: there is nothing in {kept}")
    [summary] = read_episodes(kept).to_pylist()
    rows = _transitions(kept, summary["split"], summary["episode"])
    return episode_of(run_dir, manifest, rows, summary)


def episode_of(
    run_dir: Path, manifest: Manifest, rows: dict[str, np.ndarray], summary: dict[str, Any]
) -> LoggedEpisode:
    """An episode whose rows and summary have been read.

    Raises:
        ArtifactError: they do not agree.
    """
    split, episode = summary["split"], summary["episode"]
    _check_complete(run_dir, split, episode, rows, summary)
    initial, final = (np.array(summary[name], dtype=np.float64) for name in ("initial_state", "final_state"))
    return LoggedEpisode(run_dir, manifest, split, episode, rows, summary, initial, final)


def read_episodes(run_dir: Path) -> pa.Table:
    """episodes.parquet.

    Raises:
        ArtifactError: it is missing, damaged or of another schema.
    """
    path = run_dir / "episodes.parquet"
    table = read_parquet(path, missing=f"{run_dir} has logged no episode yet")
    check_schema(table.schema, EPISODES, path)
    return table


def _episode_summary(run_dir: Path, split: str, episode: int) -> dict[str, Any]:
    table = read_episodes(run_dir)
    of_split = np.array(table["split"].to_pylist(), dtype=str) == split
    found = np.flatnonzero(of_split & (table["episode"].to_numpy() == episode))
    if not len(found):
        raise ArtifactError(f"no {split} episode {episode} in {run_dir}; {_available(table)}")
    return table.slice(int(found[0]), 1).to_pylist()[0]


def _available(table: pa.Table) -> str:
    """Which episodes there are, in words."""
    split, number = table["split"].to_pylist(), table["episode"].to_numpy()
    ranges = []
    for name in sorted(set(split)):
        of_split = number[[other == name for other in split]]
        ranges.append(f"{name} {of_split.min()} to {of_split.max()}")
    return f"there are: {', '.join(ranges)}" if ranges else "it has none yet"


def _transitions(run_dir: Path, split: str, episode: int) -> dict[str, np.ndarray]:
    parts = transition_parts(run_dir)
    if not parts:
        raise ArtifactError(f"{run_dir} has no transitions/part-*.parquet: the run was logged elsewhere or cut short")
    wanted = (ds.field("split").cast(pa.string()) == split) & (ds.field("episode") == episode)
    for part in parts:
        check_part(part)
        table = read_rows(part, wanted)
        if table.num_rows:
            return columns(table.sort_by("step"))
    raise ArtifactError(f"{run_dir}: episodes.parquet names {split} episode {episode}, but no transitions part has it")


def check_part(path: Path) -> None:
    """Pass if a file of transitions has the columns of its schema; ArtifactError names those it lacks."""
    schema = reading(path, lambda: pq.read_schema(path))
    try:
        sizes = schema.field("observation").type.list_size, schema.field("action").type.list_size
    except (KeyError, AttributeError) as error:
        raise ArtifactError(f"{path} is not a transitions file of this pipeline: {error}") from error
    check_schema(schema, transitions(*sizes), path)


def columns(table: pa.Table) -> dict[str, np.ndarray]:
    """A table of transitions by column: (n,) or (n, d)."""
    return {name: to_numpy(table[name]) for name in table.column_names}


def _check_complete(
    run_dir: Path, split: str, episode: int, rows: dict[str, np.ndarray], summary: dict[str, Any]
) -> None:
    steps = rows["step"]
    if len(steps) != summary["length"] or not np.array_equal(steps, np.arange(len(steps))):
        raise ArtifactError(
            f"{run_dir}: {split} episode {episode} should have {summary['length']} steps, "
            f"its transitions have {len(steps)}: the logs are incomplete"
        )
