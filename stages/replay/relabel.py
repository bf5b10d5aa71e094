"""Counterfactual rewards: a run's logged transitions as another scheme, or another estimator, would have scored them.

Actions and states stay what they were. What an estimate changes is made again by replaying every episode before the
run's camera: the estimate, the rewards that follow from it, and the observations that hold it.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.arrays import constant, to_arrow
from schemas.errors import ArtifactError, ConfigError
from schemas.files import write_parquet
from schemas.manifest import Manifest, read_manifest
from schemas.progress import Progress, Task
from stages.replay import relabelling
from stages.replay.frames import run_camera
from stages.replay.logs import LoggedEpisode, check_part, columns, episode_of, read_episodes
from stages.replay.parquet import reading
from stages.replay.reestimate import Eye, reestimate
from stages.replay.relabelling import Rows
from stages.replay.rollout import look
from stages.replay.simulate import scene_of
from stages.sim.renderer import Renderer
from stages.sim.world import World

ReplaceCube = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(observations (n, o), cube positions (n, 3) [m]) → the same observations of those cubes; the policy room's."""


@dataclass(frozen=True)
class Labels:
    """What the new labels are."""

    run_id: str  # NAME/CELL of the result
    config: dict[str, Any]  # the run's, with the new scheme and switch
    replace_cube: ReplaceCube
    eye: Eye | None  # who estimates again; None: the estimates stay

    @property
    def scheme(self) -> str:
        """The one whose rewards are chosen."""
        return str(self.config["run"]["scheme"])


@dataclass(frozen=True)
class _Source:
    """The run that is labelled anew."""

    directory: Path
    manifest: Manifest
    summaries: dict[tuple[str, int], dict[str, Any]]  # rows of episodes.parquet by split and number


def relabel(run_dir: Path, labels: Labels, out: Path, progress: Progress) -> dict[str, Any]:
    """Write transitions/part-*.parquet and episodes.parquet into `out`, in the layout of a run's; the summary.

    Parts that are there already, from an interrupted call, are left as they are.

    Raises:
        ArtifactError: the run is damaged.
        ConfigError: see `check_possible`.
        MachineError: there is no OpenGL to render with.
    """
    manifest, episodes = read_manifest(run_dir), read_episodes(run_dir)
    check_possible(manifest, labels.scheme, labels.eye is not None)
    source = _Source(run_dir, manifest, {(row["split"], row["episode"]): row for row in episodes.to_pylist()})
    (out / "transitions").mkdir(exist_ok=True)
    with progress.task(f"relabel {labels.run_id}", episodes.num_rows) as task:
        for part in sorted((run_dir / "transitions").glob("part-*.parquet")):
            target = out / "transitions" / part.name
            if not target.exists():
                write_parquet(_relabelled(source, part, labels, task), target)
    written = [pq.read_table(path) for path in sorted((out / "transitions").glob("part-*.parquet"))]
    rows = pa.concat_tables(written).unify_dictionaries() if written else None
    if rows is None:
        raise ArtifactError(f"{run_dir} has no transitions/part-*.parquet: there is nothing to label")
    write_parquet(_episodes(episodes, rows, labels), out / "episodes.parquet")
    return _summary(rows)


def check_possible(manifest: Manifest, scheme: str, estimated_again: bool) -> None:
    """Pass if the logs hold what the scheme's policy would have been given.

    Raises:
        ConfigError: it would have been given estimates, and the run acted on the true state.
    """
    if manifest.config["run"]["scheme"] == "oracle" and scheme != "oracle" and not estimated_again:
        raise ConfigError(
            f"{manifest.id} saw the true state and {scheme} sees estimates: name with --estimator who makes them"
        )


def _relabelled(source: _Source, part: Path, labels: Labels, task: Task) -> pa.Table:
    """One part with its new labels."""
    check_part(part)
    table = reading(part, lambda: pq.read_table(part))
    changed: list[Rows] = []
    with ExitStack() as stack:
        observer = _Observer(labels, stack)
        for rows in _by_episode(columns(table)):
            summary = source.summaries.get((str(rows["split"][0]), int(rows["episode"][0])))
            if summary is None:
                raise ArtifactError(f"{part} has an episode that episodes.parquet does not name: the run is damaged")
            logged = episode_of(source.directory, source.manifest, rows, summary)
            changed.append(_labelled(observer.again(logged), labels))
            task.advance()
    table = _with(table, {name: np.concatenate([each[name] for each in changed]) for name in changed[0]})
    for name, value in {"run": labels.run_id, "scheme": labels.scheme}.items():
        place = table.schema.get_field_index(name)
        field = table.schema.field(place)
        table = table.set_column(place, field, constant(field.type, value, len(table)))
    return table


def _with(table: pa.Table, values: Rows) -> pa.Table:
    """The table with these columns in place of its own of the same name."""
    for name, column in values.items():
        place = table.schema.get_field_index(name)
        field = table.schema.field(place)
        table = table.set_column(place, field, to_arrow(field.type, column))
    return table


def _by_episode(rows: Rows) -> Iterator[Rows]:
    """The episodes of a part, which holds whole ones."""
    starts = [*np.flatnonzero(rows["step"] == 0), len(rows["step"])]
    for start, end in pairwise(starts):
        yield {name: values[start:end] for name, values in rows.items()}


class _Observer:
    """Sees episodes again as the new scheme's policy would have seen them."""

    def __init__(self, labels: Labels, stack: ExitStack) -> None:
        self._labels, self._stack = labels, stack
        self._renderer: Renderer | None = None

    def again(self, logged: LoggedEpisode) -> LoggedEpisode:
        """With other estimates and observations where the scheme or the estimator asks for them."""
        eye = self._labels.eye
        if eye:
            estimates = eye.predict(self._frames(logged, eye.image_size))  # (n + 1, 3)
            logged = reestimate(logged, estimates[1:], eye.name)
        if self._labels.scheme == "oracle":
            first = World(scene_of(logged), logged.task).reset(logged.initial_state)["cube_position"]
            return self._seeing(logged, np.concatenate([first[None], logged.vector("cube_true")]))
        return self._seeing(logged, estimates) if eye else logged

    def _seeing(self, logged: LoggedEpisode, cubes: np.ndarray) -> LoggedEpisode:
        """Observations of `cubes` (n + 1, 3) before and after each action."""
        replace_cube = self._labels.replace_cube
        logged.rows["observation"] = replace_cube(logged.rows["observation"], cubes[:-1])
        logged.rows["next_observation"] = replace_cube(logged.rows["next_observation"], cubes[1:])
        return logged

    def _frames(self, logged: LoggedEpisode, size: int) -> np.ndarray:
        camera = run_camera(logged)
        if self._renderer is None:
            self._renderer = self._stack.enter_context(Renderer(scene_of(logged), size, camera.config.fovy))
        return look(logged, self._renderer, camera.pose)


_LABELS = (
    *("observation", "next_observation", "cube_est_x", "cube_est_y", "cube_est_z"),
    *("distance_est", "estimation_error", "reward_dense_est", "reward_used", "phase"),
)


def _labelled(logged: LoggedEpisode, labels: Labels) -> Rows:
    """The columns that may have changed."""
    rows = logged.rows | {
        "reward_used": relabelling.used(labels.config, logged.rows),
        "phase": relabelling.phases(labels.config, logged.rows),
    }
    return {name: rows[name] for name in _LABELS}


def _episodes(episodes: pa.Table, rows: pa.Table, labels: Labels) -> pa.Table:
    """episodes.parquet of the new labels: what is a sum or a mean of them, taken again."""
    sums = ("reward_dense_est", "reward_used", "estimation_error")
    found = {
        (str(each["split"][0]), int(each["episode"][0])): each
        for each in _by_episode(columns(rows.select(["split", "episode", "step", "phase", *sums])))
    }
    made = []
    for row in episodes.to_pylist():
        new = found[row["split"], row["episode"]]
        dense_est, used, errors = (new[name] for name in sums)
        made.append(
            row
            | {"run": labels.run_id, "scheme": labels.scheme, "phase": str(new["phase"][0])}
            | {"return_dense_est": float(dense_est.sum()), "return_used": float(used.sum())}
            | {"mean_estimation_error": None if np.isnan(errors).all() else float(errors.mean())}
        )
    return pa.Table.from_pylist(made, schema=episodes.schema)


def _summary(rows: pa.Table) -> dict[str, Any]:
    """Headline figures for the manifest."""
    error = pa.compute.mean(rows["estimation_error"]).as_py()
    return {
        "transitions": rows.num_rows,
        "mean_reward_used": pa.compute.mean(rows["reward_used"]).as_py(),
        "estimation_error": error,
    }
