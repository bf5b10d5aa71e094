"""What the scripted controllers do: goals for the gripper, one a control step, endlessly.

Both go round in cycles rather than stop at success, or most frames would show the same finished scene: the cube is
touched, pushed, carried and put elsewhere, and the arm keeps getting out of the camera's way. Policies that learn from
rewards neither keep the gripper upright nor stop lifting at some height, and an estimator that has not seen a cube like
theirs is off by centimetres: so the arm leans, other ways every time, and carries as high as it is seen.
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
CARRY_HEIGHTS = (0.05, 0.35)  # [m] above the table, of goals in the air; higher up the camera loses the cube
CARRIES = (2, 5)  # goals in the air that a grasped cube is carried to
SWEEP_HEIGHTS = (0.03, 0.25)  # of goals in reach: coming from low, the gripper pushes the cube aside
AROUND = 0.06  # [m] beside and above the cube, at most, where an open gripper hovers before it grasps
POSTURE = 0.8  # [rad] by which a leaning arm's joints are off their rest pose, at most
BEYOND = 1.5  # times the half-range of the cube's start: cubes are pushed and dropped outside of it

StateNow = Callable[[], np.void]


class Goal(NamedTuple):
    """Where the gripper should be going now."""

    position: np.ndarray  # (3,) [m] of the gripper point in the world
    gripper: float = CLOSED
    grasped: np.ndarray | None = None  # (w, x, y, z) of the cube whose sides the fingers should meet squarely, if any
    posture: np.ndarray | None = (
        None  # (7,) [rad] off the rest pose to which the arm leans; None: the gripper points down
    )


Aim = Callable[[], Goal]
"""The goal as it is now: the cube moves."""


def touch_and_push(state: StateNow, half_range: float, rng: np.random.Generator) -> Iterator[Goal]:
    """Go for the cube until touching it, push on a little, go somewhere else above the table, again."""
    while True:
        posture = _leaning_or_not(rng)
        yield from _go(state, _at_cube(state, posture=posture), lambda: state()["touched"])
        yield from _stay(_at_cube(state, posture=posture), int(rng.integers(*DWELL)))
        yield from _go(state, _fixed(_in_the_air(half_range, SWEEP_HEIGHTS, rng), posture=_leaning_or_not(rng)))


def pick_and_place(state: StateNow, half_range: float, rng: np.random.Generator) -> Iterator[Goal]:
    """Hover around the cube, grasp it, carry it about, put it down elsewhere or drop it, move away, again."""
    wide = BEYOND * half_range

    def squarely(gripper: float, offset: np.ndarray) -> Aim:
        return lambda: Goal(state()["cube_position"] + offset, gripper, state()["cube_quaternion"])

    while True:
        yield from _go(state, _at_cube(state, OPEN, _around(rng), _leaning(rng)))
        yield from _go(state, squarely(OPEN, APPROACH))
        yield from _go(state, squarely(OPEN, np.zeros(3)))
        yield from _stay(squarely(CLOSED, np.zeros(3)), GRASP_STEPS)
        for _ in range(int(rng.integers(*CARRIES))):
            carried = _fixed(_in_the_air(wide, CARRY_HEIGHTS, rng), posture=_leaning(rng))
            yield from _go(state, carried)
            yield from _stay(carried, int(rng.integers(*DWELL)))
        if rng.random() < 0.5:
            placed = _on_the_table(wide, rng)
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


def _fixed(position: np.ndarray, gripper: float = CLOSED, posture: np.ndarray | None = None) -> Aim:
    return lambda: Goal(position, gripper, posture=posture)


def _at_cube(
    state: StateNow, gripper: float = CLOSED, offset: np.ndarray | float = 0.0, posture: np.ndarray | None = None
) -> Aim:
    return lambda: Goal(state()["cube_position"] + offset, gripper, posture=posture)


def _around(rng: np.random.Generator) -> np.ndarray:
    return np.append(rng.uniform(-AROUND, AROUND, 2), rng.uniform(0, AROUND))


def _leaning(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-POSTURE, POSTURE, 7)


def _leaning_or_not(rng: np.random.Generator) -> np.ndarray | None:
    return _leaning(rng) if rng.random() < 0.5 else None


def _in_the_air(half_range: float, heights: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    return np.append(rng.uniform(-half_range, half_range, 2), TABLE_HEIGHT + rng.uniform(*heights))


def _on_the_table(half_range: float, rng: np.random.Generator) -> np.ndarray:
    return np.append(rng.uniform(-half_range, half_range, 2), TABLE_HEIGHT + CUBE_HALF_SIZE)
