"""Episodes of a run, or of a run's new labels."""

from collections.abc import Generator, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.errors import ArtifactError, ConfigError
from schemas.files import CHECKED, reading, transition_parts
from schemas.manifest import Manifest, read_manifest
from stages.replay.formats.episodes import IMAGE, STATE, Episode, Source
from stages.replay.logs import LoggedEpisode, check_part, columns, episode_of, read_episodes
from stages.replay.onlooker import Onlooker, replayed
from stages.replay.simulate import scene_of

SPLITS = ("train", "eval", "final")
_ROWS_AT_ONCE = 8192  # of a part: a few MB
_FROM_ESTIMATE = ("reward_dense_est", "cube_est")


def run_source(run_dir: Path, split: str | None, limit: int | None, images: bool, states: bool) -> Source:
    """Episodes of the run in `run_dir`: of one split or of all, at most `limit`, as the logs have them.

    With `images` or the simulator's `states` each episode is simulated again, for images before the run's camera.

    Raises:
        ArtifactError: it is no run, or damaged.
        ConfigError: it has no such episode.
    """
    manifest = read_manifest(run_dir)
    if manifest.stage not in ("train-policy", "relabel"):
        raise ArtifactError(f"{run_dir} is an artifact of {manifest.stage}, not a run")
    summaries = {(row["split"], row["episode"]): row for row in read_episodes(run_dir).to_pylist()}
    found = sum(split in (None, of) for of, _ in summaries)
    if not found:
        there = ", ".join(sorted({of for of, _ in summaries})) or "none yet"
        raise ConfigError(f"{manifest.id} has no episode of the split {split}; there: {there}")
    total = found if limit is None else min(limit, found)

    def read() -> Generator[Episode, None, None]:
        logged = _logged(run_dir, manifest, summaries, split)
        with ExitStack() as stack:
            replay = _Replay(Onlooker(stack) if images else None) if images or states else None
            for each in islice(logged, total):
                yield _episode(each, replay)

    world = manifest.config["world"]
    return Source(manifest.id, str(world["robot"]), world, has_rewards=True, total=total, read=read)


def _logged(
    run_dir: Path, manifest: Manifest, summaries: dict[tuple[str, int], dict[str, Any]], split: str | None
) -> Iterator[LoggedEpisode]:
    for part in transition_parts(run_dir):
        check_part(part)
        for table in _tables(part):
            key = str(table["split"][0]), int(table["episode"][0].as_py())
            if key not in summaries:
                raise ArtifactError(f"{part} has an episode that episodes.parquet does not name: the run is damaged")
            if split in (None, key[0]):
                yield episode_of(run_dir, manifest, columns(table), summaries[key])


def _tables(part: Path) -> Iterator[pa.Table]:
    """The episodes of a part, which holds whole ones."""
    file = reading(part, lambda: pq.ParquetFile(part, **CHECKED))
    rest = file.schema_arrow.empty_table()
    batches = file.iter_batches(_ROWS_AT_ONCE)
    while (batch := reading(part, lambda: next(batches, None))) is not None:
        rows = pa.concat_tables([rest, pa.Table.from_batches([batch])])
        starts = np.flatnonzero(rows["step"].to_numpy() == 0)
        for start, end in pairwise(starts):
            yield rows.slice(start, end - start)
        rest = rows.slice(starts[-1]) if len(starts) else rows
    if rest.num_rows:
        yield rest


@dataclass(frozen=True)
class _Replay:
    """What of an episode takes a replay: its states, and frames where an `onlooker` watches."""

    onlooker: Onlooker | None

    def watch(self, logged: LoggedEpisode) -> tuple[np.ndarray, np.ndarray | None]:
        """States (n + 1, k): time [s], qpos, qvel; frames (n + 1, H, W, 3) uint8."""
        states, frames = self.onlooker.watch(logged) if self.onlooker else (replayed(logged), None)
        model = scene_of(logged).model
        return states[:, : 1 + model.nq + model.nv], frames  # an integration state begins with them


def _episode(logged: LoggedEpisode, replay: _Replay | None) -> Episode:
    rows = logged.rows
    observations = {STATE: np.concatenate([rows["observation"], rows["next_observation"][-1:]])}
    states, frames = replay.watch(logged) if replay else (None, None)
    if frames is not None:
        observations[IMAGE] = frames
    return Episode(
        task=logged.task,
        split=logged.split,
        number=logged.episode,
        steps=rows["step"].astype(np.int64),
        observations=observations,
        actions=rows["action"],
        rewards=rows["reward_used"],
        signals=_signals(logged),
        terminated=rows["terminated"],
        truncated=rows["truncated"],
        states=states,
    )


def _signals(logged: LoggedEpisode) -> dict[str, np.ndarray]:
    """The other rewards, the cube [m] and success; without estimator there are none that follow from an estimate."""
    rewards = {name: logged.rows[name] for name in ("reward_dense_true", "reward_dense_est", "reward_sparse")}
    cubes = {name: logged.vector(name) for name in ("cube_true", "cube_est")}
    found = {**rewards, **cubes, "success": logged.rows["success"]}
    estimated = logged.manifest.config.get("estimator") is not None
    return {name: values for name, values in found.items() if estimated or name not in _FROM_ESTIMATE}
