"""What is exported: episodes as arrays, the same for every format, one in memory at a time."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

STATE = "state"  # what is known of the robot, and of the cube as the policy saw it
ENVIRONMENT_STATE = "environment_state"  # the truth
IMAGE = "image"

INSTRUCTIONS = {
    "reach": "Touch the cube with the end of the gripper.",
    "lift": "Grasp the cube and lift it 4 cm above the table.",
}
"""Tasks in words, for policies that read them."""


@dataclass(frozen=True)
class Episode:
    """n actions and what was seen before each of them.

    Observations have n + 1 rows where the state after the last action was seen too, else n: see `is_closed`.
    """

    task: str  # reach | lift
    split: str  # train | eval | final of a run; train | validation | test of a dataset
    number: int  # counted from 0, within the split of a run
    steps: np.ndarray  # (n,) int64: the step of the simulation that each action belongs to
    observations: dict[str, np.ndarray]  # (n, d) float32 by name; image: (n, H, W, 3) uint8
    actions: np.ndarray  # (n, a) float32, each within −1 and 1
    rewards: np.ndarray  # (n,) float32, of the state after the action; 0 where there were none
    signals: dict[str, np.ndarray]  # (n,) or (n, d): what else is known of the state after the action
    terminated: np.ndarray  # (n,) bool
    truncated: np.ndarray  # (n,) bool
    states: np.ndarray | None = None  # (n + 1, k) float64: MuJoCo's time [s], qpos and qvel

    @property
    def length(self) -> int:
        """Number of actions, n."""
        return len(self.actions)

    @property
    def is_closed(self) -> bool:
        """Whether row i + 1 of the observations is what action i led to, up to the last."""
        return all(len(rows) == self.length + 1 for rows in self.observations.values())


@dataclass(frozen=True)
class Source:
    """Episodes of one artifact, in the order they were logged."""

    id: str
    robot: str
    world: dict[str, Any]  # the artifact's WorldConfig
    has_rewards: bool
    total: int  # number of episodes that `read` gives
    read: Callable[[], Generator[Episode, None, None]]
