"""Configuration of estimator training (SPEC §4)."""

from typing import Annotated

from pydantic import Field

from schemas.config import Config, Device, Precision


class PerceptionConfig(Config):
    """ResNet34 regression of the cube's position."""

    epochs: Annotated[int, Field(ge=1, le=100_000)] = 500
    batch_size: Annotated[int, Field(ge=2, le=65_536)] = 32
    """Frames a step, at least two: batch normalisation has no variance of one."""
    learning_rate: Annotated[float, Field(gt=0, le=1)] = 1e-3
    """Peak of a one-cycle schedule (linear warm-up, cosine decay to zero)."""
    weight_decay: Annotated[float, Field(ge=0, le=1)] = 1e-4
    precision: Precision = "bfloat16"
    """Arithmetic of training (autocast) and of the estimator; trained weights stay float32."""
    quantise: bool = True
    """Let CPUs made for it run the trained estimator in 8-bit integers: a third less time, the error about the same."""
    test_misalignments: tuple[Annotated[float, Field(ge=0, le=90)], ...] = (5.0, 10.0)
    """Angles [degrees] at which the test frames are re-rendered, for both kinds of misalignment."""
    checkpoint_epochs: Annotated[int, Field(ge=1)] = 1
    """Epochs between checkpoints for `--resume`."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    device: Device = "cpu"


class PerceptionStageConfig(Config):
    """Everything an estimator depends on, besides its dataset."""

    perception: PerceptionConfig = PerceptionConfig()
