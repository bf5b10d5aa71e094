"""What a state of the world is: the record that crosses processes, and the vector that replay starts from."""

from typing import Any

import mujoco
import numpy as np

from schemas.errors import ArtifactError

# What replay needs: time, positions, velocities, and the solver's warm start, on which the next step depends.
_STATE_SPEC = int(mujoco.mjtState.mjSTATE_FULLPHYSICS) | int(mujoco.mjtState.mjSTATE_WARMSTART)

# By default MuJoCo writes warnings into MUJOCO_LOG.TXT of the working directory; they are read from MjData instead.
mujoco.set_mju_user_warning(lambda _: None)

_BAD = [getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}") for what in ("QPOS", "QVEL", "QACC", "CTRL")]

STATE_DTYPE = np.dtype(
    [
        ("time_ns", "i8"),
        ("qpos", "f8", 7),  # [rad]
        ("qvel", "f8", 7),  # [rad/s]
        ("gripper_opening", "f8"),  # distance between the finger pads [m]
        ("gripper_goal", "f8"),  # what the gripper is closing or opening towards, −1 open to 1 closed
        ("eef", "f8", 3),  # gripper point in the world [m]
        ("cube_position", "f8", 3),  # centre in the world [m]
        ("cube_quaternion", "f8", 4),  # (w, x, y, z)
        ("touched", "?"),
        ("grasped", "?"),
        ("lifted", "?"),
        ("unstable", "?"),  # the simulation diverged; the other fields mean nothing
    ]
)
"""One state of the world, all fields of the same instant."""


def pack_state(model: Any, data: Any) -> np.ndarray:
    """Everything the future depends on at the start of an episode: (k,) float64."""
    state = np.empty(mujoco.mj_stateSize(model, _STATE_SPEC))
    mujoco.mj_getState(model, data, state, _STATE_SPEC)
    return state


def unpack_state(model: Any, data: Any, state: np.ndarray) -> None:
    """Put `data` into a packed state.

    Raises:
        ArtifactError: the vector is of another scene.
    """
    expected = mujoco.mj_stateSize(model, _STATE_SPEC)
    if np.shape(state) != (expected,):
        raise ArtifactError(f"state of {np.size(state)} numbers, this scene has {expected}: it is of another robot")
    mujoco.mj_setState(model, data, np.asarray(state, dtype=np.float64), _STATE_SPEC)


def is_unstable(data: Any) -> bool:
    """Whether MuJoCo found a bad number since the last reset (it then resets the scene, or the control, by itself)."""
    return any(data.warning[kind].number for kind in _BAD) or not np.isfinite(data.qpos).all()
