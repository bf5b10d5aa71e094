"""Counterfactual rewards: a run's logged transitions as another scheme, or another estimator, would have scored them.

Actions and states stay what they were. What an estimate changes is made again by replaying every episode before the
run's camera: the estimate, the rewards that follow from it, and the observations that hold it.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from schemas.arrays import constant, to_arrow
from schemas.errors import ArtifactError, ConfigError
from schemas.files import read_parquet, transition_parts, write_parquet
from schemas.manifest import Manifest, read_manifest
from schemas.progress import Progress, Task
from stages.replay import relabelling
from stages.replay.logs import LoggedEpisode, check_part, columns, episode_of, read_episodes
from stages.replay.observer import Observer, ReplaceCube
from stages.replay.reestimate import Eye
from stages.replay.relabelling import Rows, acts_on_truth


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

    Parts that are there already, from an interrupted call, are left as they are where they are whole.

    Raises:
        ArtifactError: the run is damaged.
        ConfigError: see `check_possible`.
        MachineError: there is no OpenGL to render with.
    """
    manifest, episodes = read_manifest(run_dir), read_episodes(run_dir)
    check_possible(manifest, labels.scheme, labels.eye is not None)
    source = _Source(run_dir, manifest, {(row["split"], row["episode"]): row for row in episodes.to_pylist()})
    parts = transition_parts(run_dir)
    if not parts:
        raise ArtifactError(f"{run_dir} has no transitions/part-*.parquet: there is nothing to label")
    (out / "transitions").mkdir(exist_ok=True)
    with progress.task(f"relabel {labels.run_id}", episodes.num_rows) as task:
        for part in parts:
            target = out / "transitions" / part.name
            if not _is_made(target, part, labels):
                write_parquet(_relabelled(source, part, labels, task), target)
    rows = _summed(out)
    write_parquet(_episodes(episodes, rows, labels), out / "episodes.parquet")
    return _summary(rows)


def check_possible(manifest: Manifest, scheme: str, estimated_again: bool) -> None:
    """Pass if the logs hold what the scheme's policy would have been given.

    Raises:
        ConfigError: it would have been given estimates, and the run acted on the true state.
    """
    if acts_on_truth(manifest.config) and scheme != "oracle" and not estimated_again:
        raise ConfigError(
            f"{manifest.id} saw the true state and {scheme} sees estimates: name with --estimator who makes them"
        )


def _relabelled(source: _Source, part: Path, labels: Labels, task: Task) -> pa.Table:
    """One part with its new labels."""
    check_part(part)
    table = read_parquet(part)
    changed: list[Rows] = []
    with ExitStack() as stack:
        observer = Observer(acts_on_truth(labels.config), labels.eye, labels.replace_cube, stack)
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


def _is_made(target: Path, part: Path, labels: Labels) -> bool:
    """An interrupted call made this part, it is what was written, and what labels do not change is as in the run's."""
    try:
        made = read_parquet(target)
    except ArtifactError:  # not there, or damaged: it is made again
        return False
    source = read_parquet(part)
    same = [name for name in source.column_names if name not in ("run", "scheme", *_LABELS)]
    if made.schema != source.schema or not made.select(same).equals(source.select(same)):
        return False
    return set(made["run"].to_pylist()) == {labels.run_id} and set(made["scheme"].to_pylist()) == {labels.scheme}


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


_SUMMED = ("reward_dense_est", "reward_used", "estimation_error")


def _summed(out: Path) -> pa.Table:
    """What sums and means are taken of, of all parts."""
    names = ["split", "episode", "step", "phase", *_SUMMED]
    parts = transition_parts(out)
    return pa.concat_tables([read_parquet(part, names) for part in parts])


def _episodes(episodes: pa.Table, rows: pa.Table, labels: Labels) -> pa.Table:
    """episodes.parquet of the new labels: what is a sum or a mean of them, taken again."""
    found = {(str(each["split"][0]), int(each["episode"][0])): each for each in _by_episode(columns(rows))}
    made = []
    for row in episodes.to_pylist():
        new = found[row["split"], row["episode"]]
        dense_est, used, errors = (new[name] for name in _SUMMED)
        made.append(
            row
            | {"run": labels.run_id, "scheme": labels.scheme, "phase": str(new["phase"][0])}
            | {"return_dense_est": _known(dense_est.sum()), "return_used": _known(used.sum())}
            | {"mean_estimation_error": _known(errors.mean())}
        )
    return pa.Table.from_pylist(made, schema=episodes.schema)


def _known(value: float) -> float | None:
    """What was never estimated is null."""
    return None if np.isnan(value) else float(value)


def _summary(rows: pa.Table) -> dict[str, Any]:
    """Headline figures for the manifest."""
    return {
        "transitions": rows.num_rows,
        "mean_reward_used": pc.mean(rows["reward_used"]).as_py(),
        "estimation_error": pc.mean(rows["estimation_error"]).as_py(),
    }
