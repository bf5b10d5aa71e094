"""LeRobotDataset v3.0: rows in Parquet, images as video, episodes and statistics in `meta/`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stages.replay.formats import lerobot_stats
from stages.replay.formats.episodes import ENVIRONMENT_STATE, IMAGE, INSTRUCTIONS, STATE, Episode, Source
from stages.replay.formats.lerobot_files import (
    DATA_MB,
    FILES_IN_CHUNK,
    VIDEO_MB,
    Place,
    TableFiles,
    VideoFiles,
)
from stages.replay.formats.lerobot_meta import features, table, task_table
from stages.replay.formats.lerobot_stats import Statistics
from stages.sim.scene import CONTROL_FREQUENCY

_VERSION = "v3.0"
_OBSERVATIONS = {STATE: "observation.state", ENVIRONMENT_STATE: "observation.environment_state"}
_VIDEO = "observation.images.camera"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"


class LeRobotWriter:
    """Writes the directory of a dataset.

    A row is what was seen and what was done then; what followed has names that begin with `next.`. `timestamp` counts
    the rows of an episode at the control frequency, as the format has it; `step` is the step of the simulation.
    """

    def __init__(self, source: Source, path: Path) -> None:
        self._source, self._path = source, path
        self._data, self._videos = TableFiles(path / "data"), VideoFiles(path / "videos" / _VIDEO)
        self._features: dict[str, dict[str, Any]] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, Statistics]] = []
        self._tasks: list[str] = []  # a task's index is its place
        self._frames = 0

    def add(self, episode: Episode) -> int:
        """Write the rows and frames of one episode; how many."""
        n = episode.length
        columns = _columns(episode, self._source.has_rewards) | self._indices(episode)
        videos = {_VIDEO: episode.observations[IMAGE][:n]} if IMAGE in episode.observations else {}
        row = {"episode_index": len(self._episodes), "tasks": [INSTRUCTIONS[episode.task]], "length": n}
        row |= {"dataset_from_index": self._frames, "dataset_to_index": self._frames + n}
        row |= _file_columns("data", self._data.add(table(columns)))
        for name, images in videos.items():
            place, start, end = self._videos.add(images)
            row |= _file_columns(f"videos/{name}", place)
            row |= {f"videos/{name}/from_timestamp": start, f"videos/{name}/to_timestamp": end}
        found = {name: lerobot_stats.of_rows(values) for name, values in columns.items()}
        found |= {name: lerobot_stats.of_images(images) for name, images in videos.items()}
        self._features = self._features or features(columns, videos)
        self._episodes.append(row)
        self._statistics.append(found)
        self._frames += n
        return n

    def finish(self) -> None:
        """Write what is known of all episodes."""
        self.close()
        meta = self._path / "meta"
        meta.mkdir()
        _write_json(self._info(), meta / "info.json")
        every = {name: lerobot_stats.together([of[name] for of in self._statistics]) for name in self._features}
        _write_json({name: _as_lists(found) for name, found in every.items()}, meta / "stats.json")
        pq.write_table(task_table(self._tasks), meta / "tasks.parquet")
        place = Place.of(0)
        rows = [
            row | _flat(found) | _file_columns("meta/episodes", place)
            for row, found in zip(self._episodes, self._statistics, strict=True)
        ]
        pq.write_table(pa.Table.from_pylist(rows), place.path(meta / "episodes", ".parquet"))

    def close(self) -> None:
        """Close the files."""
        try:
            self._data.close()
        finally:
            self._videos.close()

    def _indices(self, episode: Episode) -> dict[str, np.ndarray]:
        """Columns that LeRobot finds rows by, (n,)."""
        if episode.task not in self._tasks:
            self._tasks.append(episode.task)
        n = episode.length
        return {
            "timestamp": (np.arange(n) / CONTROL_FREQUENCY).astype(np.float32),
            "frame_index": np.arange(n),
            "episode_index": np.full(n, len(self._episodes)),
            "index": np.arange(self._frames, self._frames + n),
            "task_index": np.full(n, self._tasks.index(episode.task)),
        }

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": _VERSION,
            "robot_type": self._source.robot,
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": FILES_IN_CHUNK,
            "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "fps": CONTROL_FREQUENCY,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": f"data/{_FILE}.parquet",
            "video_path": f"videos/{{video_key}}/{_FILE}.mp4" if _VIDEO in self._features else None,
            "features": self._features,
        }


def _columns(episode: Episode, has_rewards: bool) -> dict[str, np.ndarray]:
    """What was seen and done but for the images, and what followed, (n,) or (n, d)."""
    n = episode.length
    observed = {key: rows[:n] for key, rows in episode.observations.items() if key != IMAGE}
    rewards = {"next.reward": episode.rewards} if has_rewards else {}
    return {
        **{_OBSERVATIONS[key]: rows for key, rows in observed.items()},
        "action": episode.actions,
        **rewards,
        "next.done": episode.terminated | episode.truncated,
        "next.truncated": episode.truncated,
        **{f"next.{name}": values for name, values in episode.signals.items()},
        "step": episode.steps,
    }


def _file_columns(what: str, place: Place) -> dict[str, int]:
    return {f"{what}/chunk_index": place.chunk, f"{what}/file_index": place.file}


def _flat(statistics: dict[str, Statistics]) -> dict[str, Any]:
    """An episode's statistics as columns."""
    return {
        f"stats/{name}/{kind}": values
        for name, found in statistics.items()
        for kind, values in _as_lists(found).items()
    }


def _as_lists(statistics: Statistics) -> dict[str, Any]:
    return {kind: values.tolist() for kind, values in statistics.items()}


def _write_json(content: dict[str, Any], path: Path) -> None:
    path.write_text(json.dumps(content, indent=4), encoding="utf-8")
