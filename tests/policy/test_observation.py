"""The policy's observation, entry by entry."""

import numpy as np
import pytest

from stages.policy.config import MatrixConfig, ObservationScale, Proprioception
from stages.policy.observation import observe, sizes, with_cube
from stages.sim.state import STATE_DTYPE

SCALE = ObservationScale(cube=0.15, qpos=2.0, qvel=0.5, gripper_opening=0.04, eef=0.1, cube_to_eef=0.05)


@pytest.mark.parametrize(
    ("proprioception", "length"), [("joints", 18), ("forward_kinematics", 24), ("gripper_goal", 25)]
)
def test_every_entry_is_divided_by_the_size_of_its_kind(proprioception: Proprioception, length: int) -> None:
    """A state in which every quantity is as large as its size: nothing but ones is left, in any observation."""
    state = np.zeros(1, STATE_DTYPE)
    for field, size in (("qpos", 2.0), ("qvel", 0.5), ("gripper_opening", 0.04), ("eef", 0.1), ("gripper_goal", 1.0)):
        state[field] = size
    seen = observe(state, np.full((1, 3), 0.15), proprioception)
    np.testing.assert_allclose(seen / sizes(SCALE, proprioception), np.ones((1, length)), rtol=1e-6)


@pytest.mark.parametrize("proprioception", ["joints", "forward_kinematics", "gripper_goal"])
def test_a_cube_elsewhere_changes_what_is_seen_of_the_cube(proprioception: Proprioception) -> None:
    states, rng = np.zeros(2, STATE_DTYPE), np.random.default_rng(0)
    for field in ("qpos", "qvel", "gripper_opening", "eef", "gripper_goal"):
        states[field] = rng.normal(size=states[field].shape)
    there, elsewhere = rng.normal(size=(2, 2, 3)).astype(np.float32)
    changed = with_cube(observe(states, there, proprioception), elsewhere)
    np.testing.assert_allclose(changed, observe(states, elsewhere, proprioception), atol=1e-6)


def test_a_task_overrides_sizes_one_by_one() -> None:
    lift = {"observation_scale": {"cube_to_eef": 0.05}}
    matrix = MatrixConfig.model_validate({"observation_scale": {"cube": 0.15}, "lift": lift})
    assert matrix.for_task("reach").observation_scale == ObservationScale(cube=0.15)
    assert matrix.for_task("lift").observation_scale == ObservationScale(cube=0.15, cube_to_eef=0.05)
