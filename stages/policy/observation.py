"""What the policy sees: the cube's estimated position and proprioception (SPEC §5)."""

import numpy as np

from stages.policy.config import ObservationScale, Proprioception

_JOINTS = 18  # cube 3, joint positions 7, joint velocities 7, gripper opening 1
_DIMS: dict[Proprioception, int] = {
    "joints": _JOINTS,
    "forward_kinematics": _JOINTS + 6,  # gripper point 3, cube − gripper point 3
    "gripper_goal": _JOINTS + 7,
}


def observation_dim(proprioception: Proprioception) -> int:
    """Length of an observation."""
    return _DIMS[proprioception]


def observe(states: np.ndarray, cubes: np.ndarray, proprioception: Proprioception) -> np.ndarray:
    """Observations (n, dim) float32 of states (n,) with cube positions (n, 3) [m], estimated or, for the oracle, true.

    Order: cube [m], joint positions [rad], joint velocities [rad/s], gripper opening [m]; with forward kinematics also
    gripper point [m] and cube − gripper point [m]; last the goal of the gripper, −1 open to 1 closed.
    """
    parts = [cubes, states["qpos"], states["qvel"], states["gripper_opening"][:, None]]
    if proprioception != "joints":
        parts += [states["eef"], cubes - states["eef"]]
    if proprioception == "gripper_goal":
        parts.append(states["gripper_goal"][:, None])
    return np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind")


def sizes(scale: ObservationScale, proprioception: Proprioception) -> np.ndarray:
    """What each entry of an observation is divided by: (dim,) float32, in the order and units of `observe`."""
    parts = [(scale.cube, 3), (scale.qpos, 7), (scale.qvel, 7), (scale.gripper_opening, 1)]
    parts += [(scale.eef, 3), (scale.cube_to_eef, 3), (1.0, 1)]
    every = np.concatenate([np.full(entries, size, np.float32) for size, entries in parts])
    return every[: observation_dim(proprioception)]


def with_cube(observations: np.ndarray, cubes: np.ndarray) -> np.ndarray:
    """The same observations (n, dim) float32 of cubes (n, 3) [m] elsewhere."""
    changed = observations.copy()
    changed[:, :3] = cubes
    if observations.shape[1] > _JOINTS:
        eef = observations[:, _JOINTS : _JOINTS + 3]
        changed[:, _JOINTS + 3 : _JOINTS + 6] = cubes - eef
    return changed
