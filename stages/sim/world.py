"""State and action to next state: robosuite's physics, stepped without robosuite's Python (SPEC §3)."""

from typing import cast

import mujoco
import numpy as np

from stages.sim.config import action_dim
from stages.sim.controller import JointVelocityController
from stages.sim.gripper import gripper_control, gripper_point_offset, pad_distance
from stages.sim.scene import Scene
from stages.sim.state import STATE_DTYPE, is_unstable, pack_state, unpack_state
from stages.sim.tasks import TaskSignals

_CLOSE = np.array([1.0])


class World:
    """One arm, one cube, one table.

    Between calls the position- and velocity-dependent stage of the next physics step is already computed: robosuite
    does it at the beginning of a step from the same state, so trajectories are the same, and every derived quantity
    (gripper point, contacts) belongs to the state itself instead of lagging one substep behind.
    """

    def __init__(self, scene: Scene, task: str, *, compiled: bool = True) -> None:
        """`compiled` or not, trajectories are the same bit for bit; for one episode it is faster not."""
        self.scene, self.task = scene, task
        self.action_dim = action_dim(task)
        self._data = mujoco.MjData(scene.model)
        self._controller = JointVelocityController(scene.gains, scene.arm_qvel, scene.arm_actuators, compiled=compiled)
        self._signals = TaskSignals(scene)
        self._offset = gripper_point_offset(scene, task)
        self._gripper_goal = np.zeros(len(scene.gripper_ramp))
        self._bodies = [scene.model.body(i).name for i in range(1, scene.model.nbody)]

    def reset(self, initial_state: np.ndarray) -> np.void:
        """Start an episode from an integration state (see `integration_state`)."""
        model, data = self.scene.model, self._data
        mujoco.mj_resetData(model, data)
        unpack_state(model, data, initial_state)
        self._controller.reset()
        self._gripper_goal = np.zeros(len(self.scene.gripper_ramp))
        mujoco.mj_step1(model, data)
        return self.state()

    def step(self, action: np.ndarray) -> np.void:
        """Apply normalised joint velocities (7,), plus a gripper command in lift, −1 open to 1 closed, for 50 ms."""
        scene, data = self.scene, self._data
        action = np.asarray(action, dtype=np.float64)
        self._controller.set_goal(action[:7])
        command = action[7:] if self.task == "lift" else _CLOSE
        self._gripper_goal, data.ctrl[scene.gripper_actuators] = gripper_control(scene, self._gripper_goal, command)
        model, qvel, bias, ctrl = scene.model, data.qvel, data.qfrc_bias, data.ctrl
        for _ in range(scene.substeps):
            self._controller.control(qvel, bias, ctrl)
            mujoco.mj_step2(model, data)
            mujoco.mj_step1(model, data)
        return self.state()

    def state(self) -> np.void:
        """The present state, a record of `STATE_DTYPE`."""
        scene, data = self.scene, self._data
        record = np.zeros((), STATE_DTYPE)
        record["time_ns"] = round(data.time * 1e9)
        record["qpos"], record["qvel"] = data.qpos[scene.arm_qpos], data.qvel[scene.arm_qvel]
        record["gripper_opening"] = pad_distance(scene, data)
        record["gripper_goal"] = (self._gripper_goal * np.sign(scene.gripper_ramp)).mean()
        record["eef"] = self._gripper_point()
        record["cube_position"] = data.xpos[scene.cube_body]
        record["cube_quaternion"] = data.xquat[scene.cube_body]
        record["touched"], record["grasped"], record["lifted"] = self._signals.judge(data)
        record["unstable"] = is_unstable(data)
        return cast(np.void, record[()])

    def integration_state(self) -> np.ndarray:
        """Everything the future depends on, at the start of an episode: (k,) float64."""
        return pack_state(self.scene.model, self._data)

    def qpos_full(self) -> np.ndarray:
        """Generalised positions of the whole scene (nq,)."""
        return self._data.qpos.copy()

    def gripper_jacobian(self) -> np.ndarray:
        """d(gripper point) / d(arm joint positions), (3, 7) [m/rad]."""
        jacobian = np.empty((3, self.scene.model.nv))
        body = self.scene.model.site_bodyid[self.scene.grip_site]
        mujoco.mj_jac(self.scene.model, self._data, jacobian, None, self._gripper_point(), body)
        return jacobian[:, self.scene.arm_qvel]

    def gripper_axes(self) -> np.ndarray:
        """R_world_gripper (3, 3): columns x, y (the fingers' closing direction) and z (the approach direction)."""
        return self._data.site_xmat[self.scene.grip_site].reshape(3, 3).copy()

    def gripper_rotation_jacobian(self) -> np.ndarray:
        """Angular velocity of the gripper in the world per joint velocity, (3, 7)."""
        jacobian = np.empty((3, self.scene.model.nv))
        body = self.scene.model.site_bodyid[self.scene.grip_site]
        mujoco.mj_jac(self.scene.model, self._data, None, jacobian, self._gripper_point(), body)
        return jacobian[:, self.scene.arm_qvel]

    def link_poses(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Every body's position (3,) [m] and quaternion (w, x, y, z) in the world, by name."""
        positions, quaternions = self._data.xpos.copy(), self._data.xquat.copy()
        return {name: (positions[i], quaternions[i]) for i, name in enumerate(self._bodies, start=1)}

    def _gripper_point(self) -> np.ndarray:
        site, data = self.scene.grip_site, self._data
        return data.site_xpos[site] + data.site_xmat[site].reshape(3, 3)[:, 2] * self._offset
