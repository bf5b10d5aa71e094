"""What the scripted controllers do: goals for the gripper, one a control step, endlessly.

Both go round in cycles rather than stop at success, or most frames would show the same finished scene: the cube is
touched, pushed, carried and put elsewhere, and the arm keeps getting out of the camera's way. Policies that learn from
rewards neither keep the gripper upright nor stop lifting at some height, and an estimator that has not seen a cube like
theirs is off by decimetres: so the arm keeps to another posture in most episodes, and carries as high as the camera
sees.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT

OPEN, CLOSED = -1.0, 1.0
NEAR = 0.015  # [m] at which a goal counts as reached
PATIENCE = 60  # steps after which the next goal is taken anyway: noise or a lost cube must not stall the script
GRASP_STEPS = 8  # until the fingers have closed
DWELL = (3, 10)  # steps spent where a goal was reached, the upper end exclusive
APPROACH = np.array([0.0, 0.0, 0.10])  # [m] above the cube
CARRY_HEIGHTS = (0.05, 0.35)  # [m] above the table, of goals in the air; higher up the camera loses the cube
CARRIES = (1, 4)  # goals in the air that a grasped cube is carried to, the upper end exclusive
SWEEP_HEIGHTS = (0.03, 0.25)  # of goals in reach: coming from low, the gripper pushes the cube aside
AROUND = 0.06  # [m] beside and above the cube, at most, where an open gripper hovers: about a cube's width away
HOVERING = 0.5  # share of the grasps before which the gripper hovers beside the cube
PUTTING_DOWN = 0.5  # share of the carried cubes; the others are dropped

StateNow = Callable[[], np.void]


class Goal(NamedTuple):
    """Where the gripper should be going now."""

    position: np.ndarray  # (3,) [m] of the gripper point in the world
    gripper: float = CLOSED
    grasped: np.ndarray | None = None  # (w, x, y, z) of the cube whose sides the fingers should meet squarely, if any
    posture: np.ndarray | None = None  # (7,) [rad] off the rest pose, to which the arm leans; None: gripper down


class Manner(NamedTuple):
    """How a script moves throughout an episode."""

    half_range: float  # [m] from the table's centre, along x and y, of where it goes and puts the cube
    posture: np.ndarray | None = None  # (7,) [rad] off the rest pose; None: the gripper points down


Aim = Callable[[], Goal]
"""The goal as it is now: the cube moves."""


def touch_and_push(state: StateNow, manner: Manner, rng: np.random.Generator) -> Iterator[Goal]:
    """Go for the cube until touching it, push on a little, go somewhere else above the table, again."""
    cube = _at_cube(state, CLOSED, manner.posture)
    while True:
        yield from _go(state, cube, lambda: state()["touched"])
        yield from _stay(cube, int(rng.integers(*DWELL)))
        yield from _go(state, _fixed(_in_the_air(manner, SWEEP_HEIGHTS, rng), CLOSED, manner.posture))


def pick_and_place(state: StateNow, manner: Manner, rng: np.random.Generator) -> Iterator[Goal]:
    """Hover beside the cube or not, grasp it, carry it about, put it down elsewhere or drop it, move away, again."""
    while True:
        if rng.random() < HOVERING:
            beside = _at_cube(state, OPEN, manner.posture, _around(rng))
            yield from _go(state, beside)
            yield from _stay(beside, int(rng.integers(*DWELL)))
        yield from _go(state, _at_cube(state, OPEN, manner.posture, APPROACH))
        yield from _go(state, _at_cube(state, OPEN, manner.posture))
        yield from _stay(_at_cube(state, CLOSED, manner.posture), GRASP_STEPS)
        if state()["grasped"]:  # a leaning gripper misses now and then, as policies do, and tries again
            yield from _carry(state, manner, rng)
            yield from _go(state, _fixed(_in_the_air(manner, CARRY_HEIGHTS, rng), OPEN, manner.posture))


def _carry(state: StateNow, manner: Manner, rng: np.random.Generator) -> Iterator[Goal]:
    """Take a grasped cube through the air; put it down, or leave it to fall when the gripper opens next."""
    for _ in range(int(rng.integers(*CARRIES))):
        carried = _fixed(_in_the_air(manner, CARRY_HEIGHTS, rng), CLOSED, manner.posture)
        yield from _go(state, carried)
        yield from _stay(carried, int(rng.integers(*DWELL)))
    if rng.random() < PUTTING_DOWN:
        place = _on_the_table(manner, rng)
        yield from _go(state, _fixed(place, CLOSED, manner.posture))
        yield from _stay(_fixed(place, OPEN, manner.posture), GRASP_STEPS)


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


def _fixed(position: np.ndarray, gripper: float, posture: np.ndarray | None) -> Aim:
    return lambda: Goal(position, gripper, posture=posture)


def _at_cube(state: StateNow, gripper: float, posture: np.ndarray | None, offset: np.ndarray | float = 0.0) -> Aim:
    """The cube, wherever it is; upright the fingers meet its sides squarely."""
    return lambda: Goal(state()["cube_position"] + offset, gripper, state()["cube_quaternion"], posture)


def _around(rng: np.random.Generator) -> np.ndarray:
    """Offset (3,) [m] from the cube's centre, not below it."""
    return np.append(rng.uniform(-AROUND, AROUND, 2), rng.uniform(0, AROUND))


def _in_the_air(manner: Manner, heights: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    return np.append(_within(manner, rng), TABLE_HEIGHT + rng.uniform(*heights))


def _on_the_table(manner: Manner, rng: np.random.Generator) -> np.ndarray:
    return np.append(_within(manner, rng), TABLE_HEIGHT + CUBE_HALF_SIZE)


def _within(manner: Manner, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-manner.half_range, manner.half_range, 2)
