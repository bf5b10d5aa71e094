"""Postures of the arm that a dataset needs: scripts alone would keep it near its rest pose, policies do not."""

from typing import Any

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
    data, model, joints = mujoco.MjData(scene.model), scene.model, scene.model.dof_jntid[scene.arm_qvel]
    low, high = np.where(model.jnt_limited[joints], model.jnt_range[joints].T, [[-np.inf], [np.inf]])  # (7,)
    _pose(scene, data, scene.rest_qpos)
    contacts = _contacts(scene, data)  # of links that robosuite's rest pose has overlap
    for _ in range(_TRIES):
        posture = rng.uniform(-LEAN, LEAN, 7)
        qpos = scene.rest_qpos + posture
        if not ((low < qpos).all() and (qpos < high).all()):
            continue
        _pose(scene, data, qpos)
        if _is_above_table(data.site_xpos[scene.grip_site]) and _contacts(scene, data) <= contacts:
            return posture
    raise MachineError(f"no posture of {scene.config.robot} found with its gripper above the table")


def _pose(scene: Scene, data: Any, qpos: np.ndarray) -> None:
    data.qpos[scene.arm_qpos], data.qpos[scene.gripper_qpos] = qpos, scene.gripper_rest_qpos
    data.qpos[scene.cube_qpos + 2] = 10 * TABLE_HEIGHT  # out of the way
    mujoco.mj_kinematics(scene.model, data)


def _is_above_table(point: np.ndarray) -> bool:
    x, y, z = point
    return bool(max(abs(x), abs(y)) < AWAY and HEIGHTS[0] < z - TABLE_HEIGHT < HEIGHTS[1])


def _contacts(scene: Scene, data: Any) -> set[tuple[int, int]]:
    """Pairs of geoms that touch."""
    mujoco.mj_collision(scene.model, data)
    return {(first, second) for first, second in data.contact.geom.tolist()}
