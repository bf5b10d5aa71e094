"""The scripts' goals, followed by a gripper that moves 2 cm a step without physics."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.collect.motion import closing_direction
from stages.collect.scripts import (
    AROUND,
    CARRIES,
    CARRY_HEIGHTS,
    CLOSED,
    DWELL,
    GRASP_STEPS,
    NEAR,
    OPEN,
    PATIENCE,
    POSTURE,
    Goal,
    pick_and_place,
    touch_and_push,
)
from tests.collect.small_dataset import blank_state

CUBE = np.array([0.1, -0.1, 0.825])
START = np.array([-0.1, 0.0, 1.02])


def follow(script: str, steps: int, speed: float = 0.02, seed: int = 0) -> Iterator[tuple[Goal, np.void]]:
    """Goals of the script and the states they were given in; the cube stays where it is."""
    state = blank_state()
    state["eef"], state["cube_position"], state["cube_quaternion"] = START, CUBE, [1, 0, 0, 0]
    make = {"reach": touch_and_push, "lift": pick_and_place}[script]
    goals = make(lambda: state[()], 0.15, np.random.default_rng(seed))
    for _ in range(steps):
        state["touched"] = bool(np.linalg.norm(state["eef"] - CUBE) < 0.03)
        goal = next(goals)
        yield goal, state.copy()[()]
        way = goal.position - state["eef"]
        state["eef"] += way * min(1.0, speed / max(float(np.linalg.norm(way)), 1e-9))


def test_reach_goes_for_the_cube_until_it_touches_and_pushes_on() -> None:
    goals = list(follow("reach", 60))
    pushing = [goal.position.tolist() == CUBE.tolist() for goal, state in goals if state["touched"]]
    first_touch = next(i for i, (_, state) in enumerate(goals) if state["touched"])
    assert all(goal.position.tolist() == CUBE.tolist() for goal, _ in goals[:first_touch])
    assert DWELL[0] <= pushing.index(False) < DWELL[1]


def test_reach_keeps_the_gripper_closed() -> None:
    assert {goal.gripper for goal, _ in follow("reach", 100)} == {CLOSED}


def test_lift_hovers_leaning_descends_open_from_above_and_closes_at_the_cube() -> None:
    goals = [goal for goal, _ in follow("lift", 40)]
    closing = next(i for i, goal in enumerate(goals) if goal.gripper == CLOSED)
    hovering = [goal for goal in goals[:closing] if goal.posture is not None]
    assert goals[: len(hovering)] == hovering
    assert all(0 <= goal.position[2] - CUBE[2] <= AROUND for goal in hovering)
    heights = [goal.position[2] for goal in goals[len(hovering) : closing]]
    assert heights == sorted(heights, reverse=True)
    assert heights[0] == pytest.approx(CUBE[2] + 0.10)
    assert heights[-1] == pytest.approx(CUBE[2])
    assert [goal.gripper for goal in goals[closing : closing + GRASP_STEPS]] == [CLOSED] * GRASP_STEPS


def test_lift_carries_puts_down_and_opens_there() -> None:
    goals = [goal for goal, _ in follow("lift", 120)]
    closed = [goal for goal in goals if goal.gripper == CLOSED]
    opened = next(goal for before, goal in itertools.pairwise(goals) if before.gripper > goal.gripper)
    assert max(goal.position[2] for goal in closed) >= 0.9
    assert opened.position[2] == pytest.approx(0.825)
    assert np.abs(opened.position[:2]).max() <= 0.15


def test_what_is_carried_leans_another_way_every_time() -> None:
    goals = [goal for goal, _ in follow("lift", 300) if goal.posture is not None]
    ways = {goal.posture.tobytes() for goal in goals if goal.posture is not None}
    assert len(ways) >= CARRIES[0] + 1
    assert max(float(np.abs(goal.posture).max()) for goal in goals if goal.posture is not None) <= POSTURE
    in_the_air = [goal.position[2] for goal in goals if goal.gripper == CLOSED]
    assert 0.8 + CARRY_HEIGHTS[0] <= min(in_the_air)
    assert max(in_the_air) <= 0.8 + CARRY_HEIGHTS[1]


@pytest.mark.parametrize("script", ["reach", "lift"])
def test_a_gripper_that_cannot_move_does_not_stall_the_script(script: str) -> None:
    goals = [goal.position.tolist() for goal, _ in follow(script, PATIENCE + 20, speed=0)]
    assert goals[PATIENCE - 1] == goals[0] != goals[PATIENCE + 19]


@pytest.mark.parametrize("script", ["reach", "lift"])
def test_goals_stay_above_the_table(script: str) -> None:
    assert min(goal.position[2] for goal, _ in follow(script, 300)) >= 0.825
    assert NEAR < 0.025  # so the fingers close around the cube, not above it
    assert {goal.gripper for goal, _ in follow(script, 300)} <= {OPEN, CLOSED}


@given(yaw=st.floats(-7, 7), cube_yaw=st.floats(-7, 7))
def test_fingers_close_on_two_sides_by_the_smaller_turn(yaw: float, cube_yaw: float) -> None:
    axes = Rotation.from_euler("z", yaw).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    cube = Rotation.from_euler("z", cube_yaw)
    direction = closing_direction(axes, cube.as_quat(scalar_first=True))
    in_cube = np.abs(cube.inv().apply(direction))
    assert sorted(in_cube.round(6).tolist()) == [0, 0, 1]
    assert direction @ axes[:, 1] >= np.cos(np.pi / 4) - 1e-9


def test_fingers_stay_as_they_are_without_a_cube() -> None:
    assert closing_direction(np.diag([1.0, -1.0, -1.0]), None).tolist() == [0, -1, 0]
