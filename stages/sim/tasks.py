"""Reach and lift: reset distribution, and the simulator's judgement of touch, grasp and lift."""

from typing import Any

import mujoco
import numpy as np

from stages.sim.gripper import closed_gripper_qpos
from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT, Scene
from stages.sim.state import pack_state

_CUBE, _LEFT_PAD, _RIGHT_PAD, _TOUCHING = 1, 2, 4, 8
_TOUCH_GROUPS: dict[str, tuple[str, ...]] = {
    "fingers": ("fingers",),
    "pads": ("left_pad", "right_pad"),
    "hand": ("hand",),
    "none": (),
}


class TaskSignals:
    """Noise-free completion signals from contacts and the cube's height (SPEC §5)."""

    def __init__(self, scene: Scene) -> None:
        self._cube_body = scene.cube_body
        self._lifted_above = TABLE_HEIGHT + scene.config.lift_height
        self._labels = _contact_labels(scene)

    def judge(self, data: Any) -> tuple[bool, bool, bool]:
        """(touched, grasped, lifted). Grasped and lifted as robosuite's: both pads on the cube, centre above table."""
        labels = self._labels[data.contact.geom]  # (contacts, 2)
        others = labels[:, ::-1][labels == _CUBE]
        met = int(np.bitwise_or.reduce(others)) if others.size else 0
        grasped = bool(met & _LEFT_PAD) and bool(met & _RIGHT_PAD)
        return bool(met & _TOUCHING), grasped, bool(data.xpos[self._cube_body][2] > self._lifted_above)


def _contact_labels(scene: Scene) -> np.ndarray:
    """What each geom is to the cube, as bits (ngeom,)."""
    groups = scene.finger_geoms
    labels = np.zeros(scene.model.ngeom, dtype=np.uint8)
    labels[groups["cube"]] = _CUBE
    labels[groups["left_pad"]] |= _LEFT_PAD
    labels[groups["right_pad"]] |= _RIGHT_PAD
    for group in _TOUCH_GROUPS[scene.config.touch]:
        labels[groups[group]] |= _TOUCHING
    return labels


def sample_initial_state(
    scene: Scene,
    task: str,
    rng: np.random.Generator,
    half_range: float | None = None,
    posture: np.ndarray | None = None,
) -> np.ndarray:
    """Integration state (k,) of a fresh episode: cube at rest on the table, arm near its rest pose.

    Cube position uniform within ±`half_range` [m] (the configured cube_half_range) around the table's centre, yaw
    uniform; joint positions Gaussian around robosuite's rest pose, from which the arm
    is `posture` (7,) [rad] off, if any; in reach the gripper starts closed, as it stays (paper §V-B).
    """
    config, data = scene.config, mujoco.MjData(scene.model)
    half_range = config.cube_half_range if half_range is None else half_range
    x, y = rng.uniform(-half_range, half_range, 2)
    yaw = rng.uniform(-np.pi, np.pi)
    data.qpos[scene.arm_qpos] = scene.rest_qpos + config.joint_noise * rng.standard_normal(7)
    if posture is not None:
        data.qpos[scene.arm_qpos] += posture
    data.qpos[scene.gripper_qpos] = closed_gripper_qpos(scene) if task == "reach" else scene.gripper_rest_qpos
    cube = [x, y, TABLE_HEIGHT + CUBE_HALF_SIZE, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    data.qpos[scene.cube_qpos : scene.cube_qpos + 7] = cube
    return pack_state(scene.model, data)
