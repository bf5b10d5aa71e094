"""A published policy acts as the networks it was published from."""

from pathlib import Path

import numpy as np
import pytest

from schemas.errors import ArtifactError
from stages.policy import checkpoint
from stages.policy.actor import load_actor
from stages.policy.config import TD3Config
from stages.policy.observation import observation_dim, observe
from stages.policy.td3 import TD3
from stages.sim.state import STATE_DTYPE


def _publish(out: Path) -> TD3:
    td3 = TD3(TD3Config(hidden=(8, 8)), observation_dim("forward_kinematics"), 7, [3])
    description = {"task": "reach", "proprioception": "forward_kinematics", "hidden": [8, 8]}
    checkpoint.publish(out, td3, 0, description)
    return td3


def test_acts_as_trained(tmp_path: Path) -> None:
    td3, state = _publish(tmp_path), np.zeros((), STATE_DTYPE)
    state["cube_position"], state["eef"] = [0.1, -0.05, 0.825], [0, 0, 1]
    expected = td3.act(observe(state[None], state["cube_position"][None].astype(np.float32), "forward_kinematics"))[0]
    assert np.allclose(load_actor(tmp_path).act(state[()], "reach"), expected, atol=1e-6)


def test_another_task_and_a_missing_or_damaged_policy_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="no policy"):
        load_actor(tmp_path)
    _publish(tmp_path)
    with pytest.raises(ArtifactError, match="trained to reach, not to lift"):
        load_actor(tmp_path).act(np.zeros((), STATE_DTYPE)[()], "lift")
    (tmp_path / "checkpoints" / "policy.safetensors").write_bytes(b"\x80\x04pickle")
    with pytest.raises(ArtifactError, match="no policy"):
        load_actor(tmp_path)
