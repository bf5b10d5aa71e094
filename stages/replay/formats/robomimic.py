"""robomimic's HDF5 layout: one file, a group for each trajectory, and filter keys for the splits."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from stages.replay.formats.episodes import Episode, Source
from stages.replay.formats.hdf5 import HDF5File
from stages.sim.config import WorldConfig
from stages.sim.scene import build_scene

_ROBOSUITE = 1  # robomimic's EnvType
_FILTER_KEYS = {"validation": "valid"}  # robomimic's name of a split, where it has another


class RobomimicWriter:
    """Writes `data/demo_0 …` and `mask`.

    `dones` is where an episode terminated: the horizon is a truncation, kept beside it as `truncated`. `states` are
    MuJoCo's, of a run, from which robomimic plays a trajectory back. There is `next_obs` where the next observation is
    known.
    """

    def __init__(self, source: Source, path: Path) -> None:
        self._source, self._world = source, WorldConfig.model_validate(source.world)
        self._file = HDF5File(path)
        self._data = self._file.root.create_group("data")
        self._samples = 0
        self._splits: dict[str, list[str]] = {}

    def add(self, episode: Episode) -> int:
        """Write one trajectory; its number of samples."""
        name = f"demo_{sum(map(len, self._splits.values()))}"
        self._splits.setdefault(_FILTER_KEYS.get(episode.split, episode.split), []).append(name)
        demo, n = self._data.create_group(name), episode.length
        if episode.states is not None:
            demo.attrs["model_file"] = build_scene(self._world).xml  # robomimic sets `states` in this scene
        demo.attrs.update({"num_samples": n, "split": episode.split, "episode": episode.number, "task": episode.task})
        for key, values in _datasets(episode).items():
            demo.create_dataset(key, data=values)
        for key, values in episode.observations.items():
            _observation(demo, f"obs/{key}", values[:n])
            if episode.is_closed:
                _observation(demo, f"next_obs/{key}", values[1:])
        self._file.check()
        self._samples += n
        return n

    def finish(self) -> None:
        """Write what is known of all trajectories."""
        self._data.attrs["total"] = self._samples
        self._data.attrs["env_args"] = json.dumps(_environment(self._world))
        self._data.attrs["source"] = self._source.id
        for split, names in self._splits.items():
            self._file.root.create_dataset(f"mask/{split}", data=np.array(names, dtype="S"))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _datasets(episode: Episode) -> dict[str, np.ndarray]:
    """Rows (n, …) by name."""
    states = {} if episode.states is None else {"states": episode.states[:-1]}
    return {
        "actions": episode.actions,
        "rewards": episode.rewards,
        "dones": episode.terminated.astype(np.int64),
        "truncated": episode.truncated.astype(np.int64),
        "steps": episode.steps,
        **states,
        **episode.signals,
    }


def _observation(demo: h5py.Group, name: str, values: np.ndarray) -> None:
    """Images are compressed one by one, so that a reader takes a single one."""
    if values.ndim == 4:
        demo.create_dataset(name, data=values, chunks=(1, *values.shape[1:]), compression="gzip", compression_opts=1)
    else:
        demo.create_dataset(name, data=values)


def _environment(world: WorldConfig) -> dict[str, Any]:
    """env_args: robosuite's own environment that the episodes were made in, but for the size of its cube."""
    from stages.sim.robosuite_scene import stock_settings  # imports robosuite: half a second

    return {"env_name": "Lift", "env_type": _ROBOSUITE, "env_kwargs": stock_settings(world)}
