"""States, frames and actions in memory that a parent and its workers share."""

import multiprocessing
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.sim.state import STATE_DTYPE


@dataclass(frozen=True)
class Arrays:
    """Shared between the parent and its workers; each world has its row."""

    states: np.ndarray
    frames: np.ndarray | None
    actions: np.ndarray
    active: np.ndarray

    def rows(self, rows: slice) -> "Arrays":
        frames = None if self.frames is None else self.frames[rows]
        return Arrays(self.states[rows], frames, self.actions[rows], self.active[rows])


@dataclass(frozen=True)
class Shared:
    """Raw shared memory and how to see it as arrays."""

    worlds: int
    image_size: int | None
    action_dim: int
    states: Any
    frames: Any
    actions: Any
    active: Any

    def arrays(self) -> Arrays:
        n, size = self.worlds, self.image_size
        frames = None if size is None else np.frombuffer(self.frames, np.uint8).reshape(n, size, size, 3)
        return Arrays(
            states=np.frombuffer(self.states, STATE_DTYPE),
            frames=frames,
            actions=np.frombuffer(self.actions, np.float32).reshape(n, self.action_dim),
            active=np.frombuffer(self.active, np.bool_),
        )


def allocate(worlds: int, image_size: int | None, action_dim: int) -> tuple[Arrays, Shared]:
    """Memory for a number of worlds, zeroed; without frames where `image_size` is None."""

    def raw(size: int) -> Any:
        return multiprocessing.RawArray("b", max(size, 1))

    frames = raw(worlds * image_size**2 * 3) if image_size else None
    states, actions = raw(worlds * STATE_DTYPE.itemsize), raw(worlds * action_dim * 4)
    shared = Shared(worlds, image_size, action_dim, states, frames, actions, raw(worlds))
    return shared.arrays(), shared
