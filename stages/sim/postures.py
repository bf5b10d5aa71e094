"""Postures of the arm that a dataset needs: scripts alone would keep it near its rest pose, policies do not."""

import mujoco
import numpy as np

from schemas.errors import MachineError
from stages.sim.scene import TABLE_HEIGHT, Scene

LEAN = 1.2  # [rad] of each joint off the rest pose, at most
HEIGHTS = (0.05, 0.45)  # [m] of the gripper point above the table
AWAY = 0.3  # [m] of the gripper point from the table's centre along x and y, at most
_TRIES = 100_000  # one in about a hundred is accepted


def sample_posture(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Joint angles (7,) [rad] off the rest pose: uniform among those with a free gripper above the table.

    Raises:
        MachineError: none found, which another robot than SPEC §3's would have to be very different for.
    """
    data = mujoco.MjData(scene.model)
    low, high = scene.model.jnt_range[scene.model.dof_jntid[scene.arm_qvel]].T  # (7,)
    for _ in range(_TRIES):
        posture = rng.uniform(-LEAN, LEAN, 7)
        qpos = scene.rest_qpos + posture
        if (low < qpos).all() and (qpos < high).all() and _is_free(scene, data, qpos):
            return posture
    raise MachineError(f"no posture of {scene.config.robot} found with its gripper above the table")


def _is_free(scene: Scene, data: mujoco.MjData, qpos: np.ndarray) -> bool:
    data.qpos[scene.arm_qpos], data.qpos[scene.gripper_qpos] = qpos, scene.gripper_rest_qpos
    data.qpos[scene.cube_qpos + 2] = 10 * TABLE_HEIGHT  # out of the way
    mujoco.mj_kinematics(scene.model, data)
    x, y, z = data.site_xpos[scene.grip_site]
    if max(abs(x), abs(y)) > AWAY or not HEIGHTS[0] < z - TABLE_HEIGHT < HEIGHTS[1]:
        return False
    mujoco.mj_collision(scene.model, data)
    return data.ncon == 0
