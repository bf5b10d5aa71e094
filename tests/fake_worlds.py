"""A fake batch of worlds for fast unit tests: a gripper point that moves where the action says, a cube that rests.

It keeps the contract of `stages.sim.pool.Worlds`; tests/sim/test_worlds_contract.py runs the same checks on both.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from stages.sim.state import STATE_DTYPE

STEP_NS = 50_000_000
SPEED = 0.05  # [m] per step at action 1
GRIPPER_RAMP = 0.2  # of its goal, −1 open to 1 closed, per step
TOUCH = 0.035  # [m]


class FakeWorlds:
    """`n` worlds; the first three action numbers move the gripper point, the image is one grey level per cube x."""

    def __init__(self, n: int, task: str = "reach", image_size: int | None = 32) -> None:
        self.action_dim = 8 if task == "lift" else 7
        self.states = np.zeros(n, STATE_DTYPE)
        self.frames = np.zeros((n, image_size, image_size, 3), np.uint8) if image_size else None
        self.active = np.ones(n, bool)
        self.diverge_at: dict[int, int] = {}  # world → step at which it becomes unstable
        self._step = 0

    def reset(self, entropies: Sequence[Sequence[int]]) -> None:
        self.states[:] = np.zeros((), STATE_DTYPE)
        self._step = 0
        for index, entropy in enumerate(entropies):
            rng = np.random.default_rng(np.random.SeedSequence(entropy))
            self.states["cube_position"][index] = [*rng.uniform(-0.15, 0.15, 2), 0.825]
            self.states["eef"][index] = [0.0, 0.0, 1.0]
            self.states["cube_quaternion"][index] = [1.0, 0.0, 0.0, 0.0]
        self._judge()

    def start_step(self, actions: np.ndarray) -> None:
        self._actions = np.clip(actions, -1, 1)

    def finish_step(self) -> None:
        moving = self.active
        self.states["eef"][moving] += SPEED * self._actions[moving, :3]
        self.states["qvel"][moving] = self._actions[moving, :7]
        command = np.sign(self._actions[moving, 7]) if self.action_dim == 8 else 1.0
        goal = self.states["gripper_goal"][moving] + GRIPPER_RAMP * command
        self.states["gripper_goal"][moving] = np.clip(goal, -1, 1)
        self.states["time_ns"][moving] += STEP_NS
        for index, step in self.diverge_at.items():
            self.states["unstable"][index] |= self._step == step
        self._step += 1
        self._judge()

    def packed_states(self) -> list[np.ndarray]:
        return [np.concatenate([state["eef"], state["cube_position"]]) for state in self.states]

    def drop(self, index: int) -> None:
        self.active[index] = False

    def close(self) -> None:
        pass

    def _judge(self) -> None:
        distance = np.linalg.norm(self.states["eef"] - self.states["cube_position"], axis=1)
        self.states["touched"] = distance < TOUCH
        if self.frames is not None:
            grey = np.clip(128 + 500 * self.states["cube_position"][:, 0], 0, 255).astype(np.uint8)
            self.frames[:] = grey[:, None, None, None]


class FakeEstimator:
    """Reads the cube's x from the fake frame; y and z are constants: an estimator with a known error."""

    camera: ClassVar = {"image_size": 32, "position": (0.75, 0, 1.35), "target": (0, 0, 0.83), "fovy": 36.0}

    def predict(self, images: np.ndarray) -> np.ndarray:
        x = (images[:, 0, 0, 0].astype(np.float32) - 128) / 500
        return np.stack([x, np.zeros_like(x), np.full_like(x, 0.825)], axis=1)
