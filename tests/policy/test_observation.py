"""The policy's observation, entry by entry."""

import numpy as np
import pytest

from stages.policy.config import MatrixConfig, ObservationScale
from stages.policy.observation import observe, sizes
from stages.sim.state import STATE_DTYPE

SCALE = ObservationScale(cube=0.15, qpos=2.0, qvel=0.5, gripper_opening=0.04, eef=0.1, cube_to_eef=0.05)


@pytest.mark.parametrize("proprioception", ["joints", "forward_kinematics"])
def test_every_entry_is_divided_by_the_size_of_its_kind(proprioception: str) -> None:
    """A state in which every quantity is as large as its size: nothing but ones is left, in either observation."""
    state = np.zeros(1, STATE_DTYPE)
    for field, size in (("qpos", 2.0), ("qvel", 0.5), ("gripper_opening", 0.04), ("eef", 0.1)):
        state[field] = size
    seen = observe(state, np.full((1, 3), 0.15), proprioception)
    np.testing.assert_allclose(seen / sizes(SCALE, proprioception), np.ones_like(seen), rtol=1e-6)


def test_a_task_overrides_sizes_one_by_one() -> None:
    lift = {"observation_scale": {"cube_to_eef": 0.05}}
    matrix = MatrixConfig.model_validate({"observation_scale": {"cube": 0.15}, "lift": lift})
    assert matrix.for_task("reach").observation_scale == ObservationScale(cube=0.15)
    assert matrix.for_task("lift").observation_scale == ObservationScale(cube=0.15, cube_to_eef=0.05)
