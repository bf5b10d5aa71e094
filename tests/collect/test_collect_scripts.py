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
    APPROACH,
    AROUND,
    CARRIES,
    CARRY_HEIGHTS,
    CLOSED,
    DWELL,
    GRASP_STEPS,
    NEAR,
    OPEN,
    PATIENCE,
    Goal,
    Manner,
    pick_and_place,
    touch_and_push,
)
from tests.collect.small_dataset import blank_state

CUBE = np.array([0.1, -0.1, 0.825])
START = np.array([-0.1, 0.0, 1.02])
HALF_RANGE = 0.15


def follow(
    script: str, steps: int, speed: float = 0.02, seed: int = 0, posture: np.ndarray | None = None, misses: bool = False
) -> Iterator[tuple[Goal, np.void]]:
    """Goals of the script and the states they were given in; the cube stays where it is, grasped unless it `misses`."""
    state = blank_state()
    state["eef"], state["cube_position"], state["cube_quaternion"] = START, CUBE, [1, 0, 0, 0]
    make = {"reach": touch_and_push, "lift": pick_and_place}[script]
    goals = make(lambda: state[()], Manner(HALF_RANGE, posture), np.random.default_rng(seed))
    for _ in range(steps):
        at_cube = bool(np.linalg.norm(state["eef"] - CUBE) < 0.03)
        state["touched"], state["grasped"] = at_cube, at_cube and not misses
        goal = next(goals)
        yield goal, state.copy()[()]
        way = goal.position - state["eef"]
        state["eef"] += way * min(1.0, speed / max(float(np.linalg.norm(way)), 1e-9))


def lift_cycle(seed: int) -> list[Goal]:
    """Goals of lift's script up to the second time that the fingers close."""
    goals = [goal for goal, _ in follow("lift", 400, seed=seed)]
    closings = [i for i in range(1, len(goals)) if goals[i].gripper > goals[i - 1].gripper]
    return goals[: closings[1]]


def places(goals: list[Goal]) -> list[list[float]]:
    """Distinct goals one after the other."""
    return [place for place, _ in itertools.groupby(goal.position.tolist() for goal in goals)]


def test_reach_goes_for_the_cube_until_it_touches_and_pushes_on() -> None:
    goals = list(follow("reach", 60))
    pushing = [goal.position.tolist() == CUBE.tolist() for goal, state in goals if state["touched"]]
    first_touch = next(i for i, (_, state) in enumerate(goals) if state["touched"])
    assert all(goal.position.tolist() == CUBE.tolist() for goal, _ in goals[:first_touch])
    assert DWELL[0] <= pushing.index(False) < DWELL[1]


def test_reach_keeps_the_gripper_closed() -> None:
    assert {goal.gripper for goal, _ in follow("reach", 100)} == {CLOSED}


def test_lift_descends_open_from_above_and_closes_at_the_cube() -> None:
    for seed in range(10):
        goals = lift_cycle(seed)
        closing = next(i for i, goal in enumerate(goals) if goal.gripper == CLOSED)
        *hovering, above, at_cube = places(goals[:closing])
        assert above == pytest.approx(CUBE + APPROACH)
        assert at_cube == pytest.approx(CUBE)
        assert len(hovering) <= 1
        for place in hovering:
            assert (np.abs(place - CUBE) <= AROUND).all()
            assert place[2] >= CUBE[2]
        assert [goal.gripper for goal in goals[closing : closing + GRASP_STEPS]] == [CLOSED] * GRASP_STEPS


def test_lift_hovers_before_some_grasps_and_puts_down_some_cubes() -> None:
    hovered, put_down = 0, 0
    for seed in range(40):
        goals = lift_cycle(seed)
        hovered += len(places(goals[: next(i for i, goal in enumerate(goals) if goal.gripper == CLOSED)])) == 3
        opened = next(goal for before, goal in itertools.pairwise(goals) if before.gripper > goal.gripper)
        assert np.abs(opened.position[:2]).max() <= HALF_RANGE
        put_down += opened.position[2] == pytest.approx(0.825)
    assert 10 <= hovered <= 30
    assert 10 <= put_down <= 30


def test_lift_carries_through_places_in_the_air() -> None:
    carries = set()
    for seed in range(40):
        closed = [goal for goal in lift_cycle(seed) if goal.gripper == CLOSED][GRASP_STEPS:]
        air = [place for place in places(closed) if place[2] != pytest.approx(0.825)]
        carries.add(len(air))
        assert all(CARRY_HEIGHTS[0] <= place[2] - 0.8 <= CARRY_HEIGHTS[1] for place in air)
        assert np.abs(np.array(air)[:, :2]).max() <= HALF_RANGE
    assert carries == set(range(*CARRIES)) == {1, 2, 3}


def test_lift_tries_again_where_it_missed() -> None:
    goals = [goal for goal, _ in follow("lift", 120, misses=True)]
    assert sum(before.gripper < goal.gripper for before, goal in itertools.pairwise(goals)) >= 2
    assert max(goal.position[2] for goal in goals) <= CUBE[2] + 0.10


@pytest.mark.parametrize("script", ["reach", "lift"])
def test_an_arm_keeps_to_its_posture(script: str) -> None:
    posture = np.arange(7.0)
    assert all(goal.posture is posture for goal, _ in follow(script, 200, posture=posture))
    assert all(goal.posture is None for goal, _ in follow(script, 200))


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
