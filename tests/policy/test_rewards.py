"""The paper's rewards at their thresholds, and as invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.policy import rewards
from stages.policy.config import RunConfig
from stages.policy.schemes import phase, reward_kind, select_reward, switches_at

DISTANCES = st.floats(0, 2)
FLAGS = st.booleans()


@pytest.mark.parametrize(
    ("distance", "reward"),
    [(0.0, 1.0), (0.03, 1.0), (0.0300001, 1 - np.tanh(0.300001)), (0.1, 1 - np.tanh(1.0)), (0.5, 1 - np.tanh(5.0))],
)
def test_reach_dense_equation_3(distance: float, reward: float) -> None:
    assert rewards.reach_dense(np.array(distance)) == pytest.approx(reward)


def test_reach_dense_jumps_from_0_709_to_1_at_3_cm() -> None:
    """tanh(0.3) = 0.2913: the step at 3 cm is what an estimate's error of a centimetre costs."""
    assert rewards.reach_dense(np.array(0.03 + 1e-9)) == pytest.approx(0.7087, abs=1e-4)


def test_reach_sparse_equation_4() -> None:
    """1 when touched, or within 3 cm of the true centre; else 0."""
    distance = np.array([0.05, 0.05, 0.03, 0.031])
    touched = np.array([False, True, False, False])
    flags = np.zeros(4, bool)
    assert rewards.sparse("reach", distance, touched, flags, flags).tolist() == [0, 1, 1, 0]
    assert rewards.succeeded("reach", distance, touched, flags).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("touched", "grasped", "lifted", "dense", "sparse"),
    [
        (False, False, False, 1 - np.tanh(0.2), 0.0),
        (True, False, False, 1 - np.tanh(0.2), 1.0),
        (True, True, False, 1.0, 1.25),
        (True, True, True, 2.25, 2.25),
        (False, False, True, 2.25, 2.25),
    ],
)
def test_lift_equations_5_and_6(touched: bool, grasped: bool, lifted: bool, dense: float, sparse: float) -> None:
    distance, flags = np.array(0.02), (np.array(touched), np.array(grasped), np.array(lifted))
    assert rewards.dense("lift", distance, *flags[1:]) == pytest.approx(dense)
    assert rewards.sparse("lift", distance, *flags) == pytest.approx(sparse)
    assert rewards.succeeded("lift", distance, flags[0], flags[2]) == lifted


@given(DISTANCES, DISTANCES, FLAGS, FLAGS)
def test_dense_rewards_never_rise_with_distance(a: float, b: float, grasped: bool, lifted: bool) -> None:
    near, far = sorted((a, b))
    for task in ("reach", "lift"):
        values = [rewards.dense(task, np.array(d), np.array(grasped), np.array(lifted)) for d in (near, far)]
        assert values[0] >= values[1] and 0 <= values[1] <= 2.25


@given(DISTANCES, FLAGS, FLAGS, FLAGS)
def test_rewards_are_within_the_papers_range(d: float, touched: bool, grasped: bool, lifted: bool) -> None:
    flags = (np.array(touched), np.array(grasped), np.array(lifted))
    assert rewards.sparse("reach", np.array(d), *flags) in (0.0, 1.0)
    assert rewards.sparse("lift", np.array(d), *flags) in (0.0, 1.0, 1.25, 2.25)


CONFIG = RunConfig(warmup_episodes=2, switch_episode=5, episodes=10)


def test_phases_of_every_scheme() -> None:
    expected = {
        "dense": ["warmup"] * 2 + ["dense"] * 8,
        "oracle": ["warmup"] * 2 + ["dense"] * 8,
        "sparse": ["warmup"] * 2 + ["sparse"] * 8,
        "dense2sparse": ["warmup"] * 2 + ["dense"] * 3 + ["sparse"] * 5,
    }
    for scheme, phases in expected.items():
        assert [phase(scheme, episode, CONFIG) for episode in range(10)] == phases  # type: ignore[arg-type]


def test_the_switch_happens_once_at_its_episode() -> None:
    assert [e for e in range(10) if switches_at("dense2sparse", e, CONFIG)] == [5]
    assert not any(switches_at("dense", e, CONFIG) for e in range(10))
    assert reward_kind("dense2sparse", 4, CONFIG) == "dense" and reward_kind("dense2sparse", 5, CONFIG) == "sparse"


def test_who_gets_which_reward() -> None:
    true, est, sparse = np.array(0.9), np.array(0.5), np.array(1.0)
    assert select_reward("oracle", "dense", true, est, sparse) == 0.9
    for scheme in ("dense", "dense2sparse"):
        assert select_reward(scheme, "dense", true, est, sparse) == 0.5  # type: ignore[arg-type]
    for scheme in ("sparse", "dense2sparse"):
        assert select_reward(scheme, "sparse", true, est, sparse) == 1.0  # type: ignore[arg-type]
