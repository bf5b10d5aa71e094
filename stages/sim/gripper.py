"""Geometry and command of the two-finger gripper, whichever robosuite gripper the arm carries."""

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from stages.sim.scene import Scene

_CLOSING_STEPS = 500  # physics steps, 1 s: every gripper is closed after a quarter of it


def gripper_control(scene: Scene, goal: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(next goal, actuator values) for a command in [−1, 1], −1 open, 1 closed.

    As robosuite's SimpleGripController: the gripper ramps its goal towards the command's sign, once per control step,
    and the goal −1…1 spans the actuators' range.
    """
    goal = np.clip(goal + scene.gripper_ramp * np.sign(command), -1.0, 1.0)
    low, high = scene.model.actuator_ctrlrange[scene.gripper_actuators].T
    control = 0.5 * (high + low) + 0.5 * (high - low) * np.clip(goal, -1, 1)
    return goal, np.clip(control, low, high)


def pad_distance(scene: Scene, data: Any) -> float:
    """Gripper opening: distance between the centres of the left and the right finger pads [m]."""
    left = data.geom_xpos[scene.finger_geoms["left_pad"]].mean(axis=0)
    right = data.geom_xpos[scene.finger_geoms["right_pad"]].mean(axis=0)
    return float(np.linalg.norm(left - right))


def gripper_point_offset(scene: Scene, task: str) -> float:
    """Distance [m] of the gripper point beyond robosuite's grip_site along the approach direction.

    fingertips: the far end of the closed fingers, 0.9 cm for the Panda's. SPEC §5 says why it matters in reach.
    """
    choice = scene.config.gripper_point
    if choice == "grip_site" or (choice == "auto" and task == "lift"):
        return 0.0
    return _fingertip_offset(scene)


@lru_cache(maxsize=4)
def closed_gripper_qpos(scene: Scene) -> np.ndarray:
    """Gripper joint positions (g,) when closed on nothing, found by closing it."""
    return _close(scene).qpos[scene.gripper_qpos].copy()


@lru_cache(maxsize=4)
def _fingertip_offset(scene: Scene) -> float:
    data = _close(scene)
    mujoco.mj_kinematics(scene.model, data)
    origin, axis = data.site_xpos[scene.grip_site], data.site_xmat[scene.grip_site].reshape(3, 3)[:, 2]
    return max(((_vertices(scene.model, data, geom) - origin) @ axis).max() for geom in scene.finger_geoms["fingers"])


def _close(scene: Scene) -> Any:
    """Data with the gripper closed and the arm held against gravity in its rest pose."""
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[scene.arm_qpos], data.qpos[scene.gripper_qpos] = scene.rest_qpos, scene.gripper_rest_qpos
    goal = np.zeros(len(scene.gripper_ramp))
    for step in range(_CLOSING_STEPS):
        mujoco.mj_step1(model, data)
        if step % scene.substeps == 0:
            goal, data.ctrl[scene.gripper_actuators] = gripper_control(scene, goal, np.ones(1))
        data.ctrl[scene.arm_actuators] = data.qfrc_bias[scene.arm_qvel]
        mujoco.mj_step2(model, data)
    return data


def _vertices(model: Any, data: Any, geom: int) -> np.ndarray:
    """Corners of a box or vertices of a mesh in the world (n, 3) [m]."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        local = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
    else:
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        local = corners * model.geom_size[geom]
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
