"""robosuite's `Lift` with a 5 cm cube, compiled, and what the world needs to know about it.

Importing robosuite and compiling take seconds: `stages.sim.scene` keeps the result.
"""

import logging
from typing import Any

import mujoco
import numpy as np

logging.disable(logging.WARNING)  # robosuite's import warns of optional parts that this project leaves out

import robosuite  # noqa: E402
from robosuite.controllers import load_composite_controller_config, load_part_controller_config  # noqa: E402
from robosuite.environments.manipulation.lift import Lift  # noqa: E402
from robosuite.models.objects import BoxObject  # noqa: E402
from robosuite.models.robots import Sawyer  # noqa: E402
from robosuite.models.tasks import ManipulationTask  # noqa: E402
from robosuite.robots import register_robot_class  # noqa: E402
from robosuite.utils.log_utils import ROBOSUITE_DEFAULT_LOGGER  # noqa: E402

logging.disable(logging.NOTSET)
ROBOSUITE_DEFAULT_LOGGER.setLevel(logging.ERROR)

from stages.sim.config import WorldConfig  # noqa: E402
from stages.sim.controller import VelocityGains  # noqa: E402
from stages.sim.scene import CONTROL_FREQUENCY, CUBE_HALF_SIZE, Facts  # noqa: E402


@register_robot_class("FixedBaseRobot")
class ThinHeadSawyer(Sawyer):
    """robosuite's Sawyer, which MuJoCo refuses since 3.3 because visual meshes of its head have no volume."""

    def get_model(self, mode: str = "mujoco") -> Any:
        """Compile with those meshes as shells. They have no part in collisions or inertia."""
        for mesh in self.root.iter("mesh"):
            if "_head_" in mesh.get("name"):
                mesh.set("inertia", "shell")
        return super().get_model(mode)


_ROBOT_MODELS = {"Sawyer": "ThinHeadSawyer"}  # the others go by their own name


class CubeLift(Lift):
    """robosuite's Lift with the paper's 5 cm cube; Lift itself draws a cube of 4.0 to 4.4 cm."""

    def _load_model(self) -> None:
        super()._load_model()
        arena = self.model.mujoco_arena  # type: ignore[has-type]  # robosuite is untyped
        self.cube = BoxObject(name="cube", size=[CUBE_HALF_SIZE] * 3, rgba=[1, 0, 0, 1], material=_red_wood())
        self.placement_initializer.reset()
        self.placement_initializer.add_objects(self.cube)
        self.model = ManipulationTask(
            mujoco_arena=arena,
            mujoco_robots=[robot.robot_model for robot in self.robots],
            mujoco_objects=self.cube,
        )


def make_environment(config: WorldConfig, **options: Any) -> Lift:
    """Stock robosuite environment of this scene; `options` go to robosuite."""
    ours = {"robots": _ROBOT_MODELS.get(config.robot, config.robot), "hard_reset": False}
    return CubeLift(**(stock_settings(config) | ours | options))


def stock_settings(config: WorldConfig) -> dict[str, Any]:
    """Keywords of robosuite's own Lift with this arm, control and horizon; only its cube is another."""
    return {
        "robots": config.robot,
        "controller_configs": _controller_config(config),
        "control_freq": CONTROL_FREQUENCY,
        "horizon": config.horizon,
        "ignore_done": True,
        "has_renderer": False,
        "has_offscreen_renderer": False,
        "use_camera_obs": False,
    }


def compile_scene(config: WorldConfig) -> tuple[Any, Facts]:
    """The compiled model, and what robosuite knows about it."""
    environment = make_environment(config)
    found = _describe(environment)
    environment.close()
    return found


def _describe(environment: Lift) -> tuple[Any, Facts]:
    robot = environment.robots[0]
    model = environment.sim.model._model
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR  # nobody reads them; a tenth of a step's time
    gripper = robot.gripper["right"]
    arm = robot.part_controllers["right"]
    facts = Facts(
        xml=environment.model.get_xml(),
        gripper_ramp=_ramp(gripper),
        gains=_gains(arm),
        arm_qpos=np.array(arm.qpos_index),
        arm_qvel=np.array(arm.qvel_index),
        arm_actuators=np.array(robot._ref_actuators_indexes_dict["right"]),
        gripper_qpos=np.array(robot._ref_gripper_joint_pos_indexes["right"]),
        gripper_actuators=np.array(robot._ref_actuators_indexes_dict["right_gripper"]),
        joint_names=tuple(robot.robot_joints),
        rest_qpos=np.array(robot.init_qpos, dtype=float),
        gripper_rest_qpos=np.array(gripper.init_qpos, dtype=float),
        cube_qpos=int(model.jnt_qposadr[model.joint(environment.cube.joints[0]).id]),
        cube_body=environment.cube_body_id,
        grip_site=model.site(gripper.important_sites["grip_site"]).id,
        finger_geoms=_geom_groups(model, gripper, environment.cube),
    )
    return model, facts


def _ramp(gripper: Any) -> np.ndarray:
    """What a command to close adds to the gripper's goal (a,) in a control step; one to open takes as much off."""
    gripper.current_action = np.zeros(gripper.dof)
    return np.array(gripper.format_action(np.ones(1)), dtype=float)


def _gains(arm: Any) -> VelocityGains:
    low, high = arm.actuator_limits
    return VelocityGains(arm.kp, arm.ki, arm.kd, low, high, float(arm.output_max[0]), arm.velocity_limits)


def _geom_groups(model: Any, gripper: Any, cube: Any) -> dict[str, np.ndarray]:
    parts = gripper.important_geoms
    names = {
        "cube": cube.contact_geoms,
        "left_pad": parts["left_fingerpad"],
        "right_pad": parts["right_fingerpad"],
        "fingers": parts["left_finger"] + parts["right_finger"],
        "hand": gripper.contact_geoms,
    }
    return {group: np.array([model.geom(name).id for name in geoms]) for group, geoms in names.items()}


def _controller_config(config: WorldConfig) -> dict[str, Any]:
    """robosuite's default JOINT_VELOCITY part for the arm, with the configured velocity range."""
    composite = load_composite_controller_config(robot=config.robot)
    part = load_part_controller_config(default_controller="JOINT_VELOCITY")
    part["output_max"], part["output_min"] = config.max_joint_velocity, -config.max_joint_velocity
    part["gripper"] = composite["body_parts"]["right"]["gripper"]
    composite["body_parts"]["right"] = part
    return composite


def _red_wood() -> Any:
    return robosuite.utils.mjcf_utils.CustomMaterial(
        texture="WoodRed",
        tex_name="redwood",
        mat_name="redwood_mat",
        tex_attrib={"type": "cube"},
        mat_attrib={"texrepeat": "1 1", "specular": "0.4", "shininess": "0.1"},
    )
