"""Configuration of dataset collection (SPEC §4)."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from schemas.config import Config
from stages.sim.config import CameraConfig, TaskName, WorldConfig

Fraction = Annotated[float, Field(ge=0, le=1)]


class CollectConfig(Config):
    """How many episodes, how they act, what is kept."""

    tasks: Annotated[tuple[TaskName, ...], Field(min_length=1)] = ("reach", "lift")
    """Tasks whose scripted controllers act, alternating by episode: both tasks share one estimator."""
    episodes: Annotated[int, Field(ge=1, le=1_000_000)] = 1600
    steps: Annotated[int, Field(ge=1, le=10_000)] = 200
    """Steps per episode."""
    keep_fraction: Annotated[float, Field(gt=0, le=1)] = 0.25
    """Fraction of the steps whose frame is rendered and kept."""
    random_fraction: Fraction = 0.4
    """Fraction of episodes that act at random; the others follow the scripted controller (or `--policy`)."""
    action_noise: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Standard deviation of the noise on policy-related actions, of the normalised range."""
    leaning_fraction: Fraction = 0.75
    """Fraction of episodes in which the arm starts in another posture and keeps to it; in the others its gripper points
    down, as no policy's does for long."""
    stray_fraction: Fraction = 0.5
    """Fraction of episodes in which the cube starts, and is carried, farther out than the task puts it: policies push
    it there, and an estimator that never saw it there leaves them without a way back."""
    stray_range: Annotated[float, Field(ge=1, le=3)] = 1.8
    """Its half-range in those episodes, in multiples of world.cube_half_range; 1.8 of 15 cm is what the camera sees."""
    camera_translation: Annotated[float, Field(ge=0, le=0.2)] = 0.01
    """Domain randomisation: half-range [m] of the camera's displacement on each axis, per episode."""
    camera_rotation: Annotated[float, Field(ge=0, le=10)] = 0.5
    """Domain randomisation: half-range [degrees] of the camera's rotation about each axis, per episode."""
    validation_fraction: Fraction = 0.1
    test_fraction: Fraction = 0.1
    image_format: Literal["png", "jpeg"] = "png"
    compression: Literal["zstd", "lz4"] = "zstd"
    """Of the MCAP chunks."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    workers: Annotated[int, Field(ge=1, le=256)] = 2
    """Processes; the dataset does not depend on it."""

    @model_validator(mode="after")
    def _leave_training_episodes(self) -> "CollectConfig":
        if self.validation_fraction + self.test_fraction >= 1:
            raise ValueError("validation_fraction + test_fraction must be below 1")
        return self


class CollectStageConfig(Config):
    """Everything a dataset depends on."""

    world: WorldConfig = WorldConfig()
    camera: CameraConfig = CameraConfig()
    collect: CollectConfig = CollectConfig()
