"""What the policy sees: the cube's estimated position and proprioception (SPEC §5)."""

import numpy as np

from stages.policy.config import ObservationScale

JOINTS_DIM = 18  # cube 3, joint positions 7, joint velocities 7, gripper opening 1
FORWARD_KINEMATICS_DIM = JOINTS_DIM + 6  # gripper point 3, cube − gripper point 3


def observation_dim(proprioception: str) -> int:
    """Length of an observation."""
    return FORWARD_KINEMATICS_DIM if proprioception == "forward_kinematics" else JOINTS_DIM


def observe(states: np.ndarray, cubes: np.ndarray, proprioception: str) -> np.ndarray:
    """Observations (n, dim) float32 of states (n,) with cube positions (n, 3) [m], estimated or, for the oracle, true.

    Order: cube [m], joint positions [rad], joint velocities [rad/s], gripper opening [m]; with forward kinematics also
    gripper point [m] and cube − gripper point [m].
    """
    parts = [cubes, states["qpos"], states["qvel"], states["gripper_opening"][:, None]]
    if proprioception == "forward_kinematics":
        parts += [states["eef"], cubes - states["eef"]]
    return np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind")


def sizes(scale: ObservationScale, proprioception: str) -> np.ndarray:
    """What each entry of an observation is divided by: (dim,) float32, in the order and units of `observe`."""
    parts = [(scale.cube, 3), (scale.qpos, 7), (scale.qvel, 7), (scale.gripper_opening, 1)]
    if proprioception == "forward_kinematics":
        parts += [(scale.eef, 3), (scale.cube_to_eef, 3)]
    return np.concatenate([np.full(entries, size, np.float32) for size, entries in parts])


def with_cube(observations: np.ndarray, cubes: np.ndarray) -> np.ndarray:
    """The same observations (n, dim) float32 of cubes (n, 3) [m] elsewhere."""
    changed = observations.copy()
    changed[:, :3] = cubes
    if observations.shape[1] == FORWARD_KINEMATICS_DIM:
        changed[:, -3:] = cubes - observations[:, JOINTS_DIM : JOINTS_DIM + 3]
    return changed
