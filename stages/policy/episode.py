"""One episode of every run of a group, as it is stepped: columns of (runs, steps, …)."""

from typing import Any

import numpy as np

from stages.policy.scoring import Scores

_SCALARS = (*Scores._fields, "reward_used", "touched", "grasped", "lifted", "time_ns")
_FLAGS = ("touched", "grasped", "lifted", "success")


class EpisodeColumns:
    """Columns of the transition log under their names; positions stay (…, 3) until they are written."""

    def __init__(self, runs: int, steps: int, observation_dim: int, action_dim: int) -> None:
        self.steps = steps
        self.columns: dict[str, np.ndarray] = {
            "observation": np.zeros((runs, steps, observation_dim), np.float32),
            "next_observation": np.zeros((runs, steps, observation_dim), np.float32),
            "action": np.zeros((runs, steps, action_dim), np.float32),
        }
        for name in ("eef", "cube_true", "cube_est"):
            self.columns[name] = np.zeros((runs, steps, 3), np.float32)
        for name in _SCALARS:
            kind: Any = np.bool_ if name in _FLAGS else np.int64 if name == "time_ns" else np.float32
            self.columns[name] = np.zeros((runs, steps), kind)

    def set(self, step: int, **values: np.ndarray) -> None:
        """Columns of one step, each (runs, …)."""
        for name, value in values.items():
            self.columns[name][:, step] = value

    def set_state(self, step: int, states: np.ndarray, cubes_est: np.ndarray, scores: Scores) -> None:
        """What the states (runs,) after a step, their estimates and scores fill."""
        self.set(
            step,
            eef=states["eef"],
            cube_true=states["cube_position"],
            cube_est=cubes_est,
            time_ns=states["time_ns"],
            touched=states["touched"],
            grasped=states["grasped"],
            lifted=states["lifted"],
            **scores._asdict(),
        )

    def of_run(self, run: int) -> dict[str, np.ndarray]:
        """One run's columns (steps, …), copied: the arrays are used again for the next episode."""
        return {name: column[run].copy() for name, column in self.columns.items()}
