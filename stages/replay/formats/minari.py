"""Minari's dataset standard: `data/main_data.hdf5` with a group for each episode, `data/metadata.json` with the spaces.

Written without the library, which would bring its environments' packages along; the tests read it back with it.
"""

import json
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from schemas.errors import ConfigError
from stages.replay.formats.episodes import Episode, Source
from stages.replay.formats.hdf5 import HDF5File

_STANDARD = "0.5.4"  # version of Minari whose layout this is


class MinariWriter:
    """Writes one episode after the other.

    Observations have one row more than actions. An episode that ends before the state its last action led to gives up
    that action. Observations are an array where there is only one kind of them, else a dictionary. `infos` have what
    else is known, with a first row for the reset: step −1, NaN or false.
    """

    def __init__(self, source: Source, path: Path) -> None:
        self._source, self._data = source, path / "data"
        self._data.mkdir(parents=True)
        self._file = HDF5File(self._data / "main_data.hdf5", track_order=True)
        self._episodes = self._steps = 0
        self._spaces: dict[str, str] = {}

    def add(self, episode: Episode) -> int:
        """Write one episode; its number of steps. One with a single observation has none, and is left out."""
        n = episode.length if episode.is_closed else episode.length - 1
        if n < 1:
            return 0
        group = self._file.root.create_group(f"episode_{self._episodes}")
        group.attrs.update({"id": self._episodes, "total_steps": n, "split": episode.split, "task": episode.task})
        group.attrs.update(_reward_figures(episode.rewards[:n]))
        _write_observations(group, {key: rows[: n + 1] for key, rows in episode.observations.items()})
        truncated = episode.truncated[:n].copy()
        truncated[-1] |= not episode.terminated[n - 1]
        rows = {"actions": episode.actions, "rewards": episode.rewards, "terminations": episode.terminated}
        for key, values in {**rows, "truncations": truncated}.items():
            group.create_dataset(key, data=values[:n], chunks=True, maxshape=(None, *values.shape[1:]))
        for key, values in {"step": episode.steps, **episode.signals}.items():
            group.create_dataset(f"infos/{key}", data=_with_reset(values[:n]))
        self._file.check()
        self._spaces = self._spaces or _spaces(episode)
        self._episodes, self._steps = self._episodes + 1, self._steps + n
        return n

    def finish(self) -> None:
        """Write the metadata.

        Raises:
            ConfigError: no episode has a step.
        """
        if not self._episodes:
            raise ConfigError(f"{self._source.id}: its episodes have one frame each, Minari needs two: try lerobot")
        self._file.root.flush()
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", self._source.id.partition("/")[2])
        metadata = {
            "dataset_id": f"dense2sparse/{name}-v0",
            "total_episodes": self._episodes,
            "total_steps": self._steps,
            "data_format": "hdf5",
            "jpeg_encoding": False,  # images are exact
            "minari_version": _STANDARD,
            "algorithm_name": self._source.id,
            "dataset_size": round((self._data / "main_data.hdf5").stat().st_size / 1e6, 1),  # [MB]
            **self._spaces,
        }
        (self._data / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _write_observations(group: h5py.Group, observations: dict[str, np.ndarray]) -> None:
    alone = len(observations) == 1
    for key, values in observations.items():
        name = "observations" if alone else f"observations/{key}"
        chunks = (1, *values.shape[1:]) if values.ndim == 4 else True
        compression = "gzip" if values.ndim == 4 else None
        maximum = (None, *values.shape[1:])
        group.create_dataset(name, data=values, chunks=chunks, maxshape=maximum, compression=compression)


def _with_reset(values: np.ndarray) -> np.ndarray:
    """Rows (n + 1, …): what is known of a state after an action is not known of the first one."""
    unknown = {"f": np.nan, "i": -1, "b": False}[values.dtype.kind]
    return np.concatenate([np.full((1, *values.shape[1:]), unknown, values.dtype), values])


def _reward_figures(rewards: np.ndarray) -> dict[str, float]:
    names = ("max", "min", "mean", "std", "sum")
    return {f"rewards_{name}": float(getattr(rewards, name)()) for name in names}


def _spaces(episode: Episode) -> dict[str, str]:
    """Of observations and actions, as Minari writes spaces of Gymnasium."""
    seen = {key: _box(rows) for key, rows in episode.observations.items()}
    observation = next(iter(seen.values())) if len(seen) == 1 else {"type": "Dict", "subspaces": seen}
    action = _box(episode.actions, -1.0, 1.0)
    return {"observation_space": json.dumps(observation), "action_space": json.dumps(action)}


def _box(rows: np.ndarray, low: float = -np.inf, high: float = np.inf) -> dict[str, Any]:
    """Space of one row; of an image every byte."""
    low, high = (0, 255) if rows.dtype == np.uint8 else (low, high)
    shape = rows.shape[1:]
    bounds = {"low": np.full(shape, low).tolist(), "high": np.full(shape, high).tolist()}
    return {"type": "Box", "dtype": str(rows.dtype), "shape": list(shape), **bounds}
