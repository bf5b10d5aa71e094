"""Rerun recordings of whatever an artifact holds, made by the rooms that know how."""

import re
from collections.abc import Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any

from pipeline.artifacts.inputs import load, load_shown
from pipeline.artifacts.names import split_id
from pipeline.artifacts.store import Store
from pipeline.machine import require_sim
from schemas.errors import ArtifactError, ConfigError

_EPISODE_FILE = re.compile(r"datasets/(?P<dataset>[^/]+)/episodes/episode-(?P<episode>\d{6})\.mcap")


def checked_save(save: Path) -> Path:
    """The file to write; ConfigError unless it is a recording in a directory that is there."""
    if save.suffix != ".rrd":
        raise ConfigError(f"--save {save}: a Rerun recording ends in .rrd")
    if not save.parent.is_dir():
        raise ConfigError(f"--save {save}: there is no directory {save.parent}")
    return save


class Recorder:
    """Records what the logs under a data root hold: the report is given one, since it knows no simulator."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def episode(self, run: str, split: str, episode: int, file: Path) -> None:
        """Of a logged episode of runs/`run`, if its replay is identical."""
        require_sim()
        from stages.replay.recording import record_episode

        record_episode(self._root / "runs" / run, split, episode, file, proven=True)

    def dataset(self, name: str, episode: int, file: Path) -> int:
        """Of an episode of datasets/`name`; its number of frames."""
        require_sim()  # for the robot's meshes, where nothing is simulated
        from stages.replay.dataset_recording import record_dataset_episode

        return record_dataset_episode(self._root / "datasets" / name, episode, file)

    def estimator(self, name: str, file: Path) -> dict[str, Any]:
        """Of the worst, median and best test frames of estimators/`name`; of which dataset, and how many."""
        require_sim()
        from stages.replay.estimator_recording import record_estimator

        dataset = load_shown(self._root, load(self._root, f"estimators/{name}").inputs[0].id).id
        directory = self._root / "estimators" / name
        return {"dataset": dataset, "frames": record_estimator(directory, self._root / dataset, file)}


def record_artifact(store: Store, artifact_id: str, split: str, episode: int, save: Path) -> dict[str, Any]:
    """Write the recording that shows an artifact best; returns what is in it."""
    kind, parts = split_id(artifact_id)
    name, recorder = "/".join(parts), Recorder(store.root)
    if kind == "runs":
        return _episode(store.path(artifact_id), split, episode, save)
    if kind == "datasets":
        return {"episode": episode, "frames": recorder.dataset(name, episode, save)}
    if kind == "estimators":
        return recorder.estimator(name, save)
    return _comparison(store.path(artifact_id), save)


def _episode(run: Path, split: str, episode: int, save: Path) -> dict[str, Any]:
    """Also one whose replay differs: that is said."""
    require_sim()
    from stages.replay.recording import record_episode

    result = record_episode(run, split, episode, save)
    warning = None if result.identical else f"the picture is of another trajectory than the logs: {result.message()}"
    return {"split": split, "episode": episode, "identical": result.identical, "warning": warning}


def record_file(store: Store, path: Path, save: Path) -> dict[str, Any]:
    """Write the recording of an MCAP file: of an episode of a dataset with the arm's meshes, of another as it is."""
    if not path.is_file():
        raise ArtifactError(f"there is no file {path}")
    inside = _EPISODE_FILE.fullmatch(str(path.resolve()).removeprefix(f"{store.root.resolve()}/"))
    if inside:
        dataset = load_shown(store.root, f"datasets/{inside['dataset']}")
        return record_artifact(store, dataset.id, "", int(inside["episode"]), save)
    from stages.replay.mcap_recording import record_mcap

    return {"topics": record_mcap(path, save)}


def record_comparison(root: Path, runs: Sequence[str], save: Path) -> dict[str, Any]:
    """Write the learning curves of runs, NAMEs (all their cells) or NAME/CELL, with their spread over seeds."""
    from stages.analyze.catalogue import artifacts, select
    from stages.analyze.curves_recording import write_comparison
    from stages.analyze.study import ask

    others = [name for name in runs if name.split("/")[0] in ("datasets", "estimators", "reports")]
    if others:
        raise ConfigError(f"several artifacts are shown by their learning curves, which only runs have: {others[0]}")
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
