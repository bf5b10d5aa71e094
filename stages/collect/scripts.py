"""What the scripted controllers do: goals for the gripper, one a control step, endlessly.

Both go round in cycles rather than stop at success, or most frames would show the same finished scene: the cube is
touched, pushed, carried and put elsewhere, and the arm keeps getting out of the camera's way.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT

OPEN, CLOSED = -1.0, 1.0
NEAR = 0.015  # [m] at which a goal counts as reached
PATIENCE = 60  # steps after which the next goal is taken anyway: noise or a lost cube must not stall the script
GRASP_STEPS = 8  # until the fingers have closed
DWELL = (3, 10)  # steps spent where a goal was reached
APPROACH = np.array([0.0, 0.0, 0.10])  # [m] above the cube
CARRY_HEIGHTS = (0.10, 0.25)  # [m] above the table, of goals in the air
SWEEP_HEIGHTS = (0.03, 0.25)  # the same in reach: coming from low, the gripper pushes the cube aside

StateNow = Callable[[], np.void]


class Goal(NamedTuple):
    """Where the gripper should be going now."""

    position: np.ndarray  # (3,) [m] of the gripper point in the world
    gripper: float = CLOSED
    grasped: np.ndarray | None = None  # (w, x, y, z) of the cube whose sides the fingers should meet squarely, if any


Aim = Callable[[], Goal]
"""The goal as it is now: the cube moves."""


def touch_and_push(state: StateNow, half_range: float, rng: np.random.Generator) -> Iterator[Goal]:
    """Go for the cube until touching it, push on a little, go somewhere else above the table, again."""

    def cube() -> Goal:
        return Goal(state()["cube_position"])

    while True:
        yield from _go(state, cube, lambda: state()["touched"])
        yield from _stay(cube, int(rng.integers(*DWELL)))
        yield from _go(state, _fixed(_in_the_air(half_range, SWEEP_HEIGHTS, rng)))


def pick_and_place(state: StateNow, half_range: float, rng: np.random.Generator) -> Iterator[Goal]:
    """Grasp the cube, carry it somewhere in the air, put it down elsewhere, move away, again."""

    def above() -> Goal:
        return Goal(state()["cube_position"] + APPROACH, OPEN, state()["cube_quaternion"])

    def at(gripper: float) -> Aim:
        return lambda: Goal(state()["cube_position"], gripper, state()["cube_quaternion"])

    while True:
        yield from _go(state, above)
        yield from _go(state, at(OPEN))
        yield from _stay(at(CLOSED), GRASP_STEPS)
        carried, placed = _in_the_air(half_range, CARRY_HEIGHTS, rng), _on_the_table(half_range, rng)
        yield from _go(state, _fixed(carried))
        yield from _stay(_fixed(carried), int(rng.integers(*DWELL)))
        yield from _go(state, _fixed(placed))
        yield from _stay(_fixed(placed, OPEN), GRASP_STEPS)
        yield from _go(state, _fixed(_in_the_air(half_range, CARRY_HEIGHTS, rng), OPEN))


def _go(state: StateNow, aim: Aim, done: Callable[[], bool] = lambda: False) -> Iterator[Goal]:
    """Pursue a goal until it is reached or `done`, or patience ends."""
    for _ in range(PATIENCE):
        goal = aim()
        if done() or np.linalg.norm(goal.position - state()["eef"]) < NEAR:
            return
        yield goal


def _stay(aim: Aim, steps: int) -> Iterator[Goal]:
    for _ in range(steps):
        yield aim()


def _fixed(position: np.ndarray, gripper: float = CLOSED) -> Aim:
    return lambda: Goal(position, gripper)


def _in_the_air(half_range: float, heights: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    return np.append(rng.uniform(-half_range, half_range, 2), TABLE_HEIGHT + rng.uniform(*heights))


def _on_the_table(half_range: float, rng: np.random.Generator) -> np.ndarray:
    return np.append(rng.uniform(-half_range, half_range, 2), TABLE_HEIGHT + CUBE_HALF_SIZE)
