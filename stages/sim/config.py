"""Configuration of the simulated world and its camera (SPEC §3)."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from schemas.config import Config

Metres = Annotated[float, Field(ge=-100, le=100)]
Vector3 = tuple[Metres, Metres, Metres]
Robot = Literal["Panda", "Sawyer", "IIWA", "Kinova3"]
TaskName = Literal["reach", "lift"]
MisalignmentKind = Literal["pan", "orbit"]


def action_dim(task: str) -> int:
    """The arm's joint velocities; in lift the gripper besides."""
    return 8 if task == "lift" else 7


class WorldConfig(Config):
    """Robot, cube and control."""

    robot: Robot = "Panda"
    """7-DoF robosuite arm with its default two-finger gripper."""
    cube_half_range: Annotated[float, Field(gt=0, le=0.3)] = 0.15
    """Half-range [m] of the cube's initial position in x and y around the table's centre."""
    joint_noise: Annotated[float, Field(ge=0, le=0.5)] = 0.02
    """Standard deviation [rad] of the initial joint positions around the robot's rest pose (robosuite's default)."""
    max_joint_velocity: Annotated[float, Field(gt=0, le=1.0)] = 0.5
    """Joint velocity [rad/s] of action ±1; robosuite's JOINT_VELOCITY limits it to 1."""
    horizon: Annotated[int, Field(ge=1, le=10_000)] = 200
    """Steps of 50 ms after which an episode is truncated."""
    lift_height: Annotated[float, Field(gt=0, le=0.5)] = 0.04
    """Height [m] of the cube's centre above the table top that counts as lifted (robosuite's own criterion)."""
    gripper_point: Literal["auto", "grip_site", "fingertips"] = "auto"
    """Point whose distance to the cube is rewarded; auto: fingertips in reach, grip_site in lift."""
    touch: Literal["fingers", "pads", "hand", "none"] = "fingers"
    """Which geoms touch: fingers with their pads, the pads alone, the whole gripper, or none: then reach is completed
    by the distance of 3 cm alone."""


class CameraConfig(Config):
    """The fixed camera: a pinhole with square pixels and image, looking at a point of the workspace."""

    image_size: Annotated[int, Field(ge=32, le=1024)] = 64
    """Width and height [pixels]."""
    position: Vector3 = (0.65, 0.0, 1.5)
    """Camera centre in the world [m]; the table top's centre is (0, 0, 0.8)."""
    target: Vector3 = (-0.02, 0.0, 0.88)
    """Point in the world [m] at the image centre."""
    fovy: Annotated[float, Field(gt=5, lt=120)] = 43.0
    """Vertical field of view [degrees]: with these defaults the cube stays in view at 10° of misalignment."""

    @model_validator(mode="after")
    def _check_direction(self) -> "CameraConfig":
        if self.position == self.target:
            raise ValueError("position and target are the same point: the camera looks nowhere")
        return self
