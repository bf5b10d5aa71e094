"""Rerun recordings of whatever an artifact holds, made by the rooms that know how."""

from collections.abc import Callable, Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any

from pipeline.artifacts.inputs import load
from pipeline.artifacts.names import split_id
from pipeline.artifacts.store import Store
from pipeline.machine import require_sim
from schemas.errors import ArtifactError, ConfigError


def recording_path(save: Path) -> Path:
    """The file to write; ConfigError unless it is a recording in a directory that is there."""
    if save.suffix != ".rrd":
        raise ConfigError(f"--save {save}: a Rerun recording ends in .rrd")
    if not save.parent.is_dir():
        raise ConfigError(f"--save {save}: there is no directory {save.parent}")
    return save


def record_episode(root: Path) -> Callable[[str, str, int, Path], None]:
    """(run, split, episode, file) → recording of a logged episode: what the report is given, since it knows no sim."""

    def record(run: str, split: str, episode: int, save: Path) -> None:
        require_sim()
        from stages.replay.recording import record_episode as replayed

        replayed(root / "runs" / run, split, episode, save)

    return record


def record_artifact(store: Store, artifact_id: str, split: str, episode: int, save: Path) -> dict[str, Any]:
    """Write the recording that shows an artifact best; returns what is in it."""
    require_sim()  # for the robot's meshes, where nothing is simulated
    kind, _ = split_id(artifact_id)
    path = store.path(artifact_id)
    if kind == "runs":
        record_episode(store.root)("/".join(split_id(artifact_id)[1]), split, episode, save)
        return {"split": split, "episode": episode}
    if kind == "datasets":
        from stages.replay.dataset_recording import record_dataset_episode

        return {"episode": episode, "frames": record_dataset_episode(path, episode, save)}
    if kind == "estimators":
        from stages.replay.estimator_recording import record_estimator

        dataset = load(store.root, artifact_id).inputs[0].id
        load(store.root, dataset)
        return {"dataset": dataset, "frames": record_estimator(path, store.path(dataset), save)}
    return _comparison(path, save)


def record_comparison(root: Path, runs: Sequence[str], save: Path) -> dict[str, Any]:
    """Write the learning curves of runs, NAMEs (all their cells) or NAME/CELL, with their spread over seeds."""
    from stages.analyze.catalogue import artifacts, select
    from stages.analyze.recordings import write_comparison
    from stages.analyze.study import ask

    chosen = select(artifacts(root, "runs"), runs)
    curves = ask(root, chosen, ["learning-curves"])["learning-curves"].rows
    if not curves:
        raise ArtifactError(f"no learning curve yet: none of {', '.join(runs)} has been evaluated while training")
    write_comparison(curves, save)
    return {"runs": len(chosen)}


def _comparison(report: Path, save: Path) -> dict[str, Any]:
    """A report brings its recording of learning curves along."""
    source = report / "comparison.rrd"
    if not source.is_file():
        raise ArtifactError(f"{report} has no {source.name}: it is on no runs; its report.html opens in any browser")
    copyfile(source, save)
    return {"recording": source.name}
