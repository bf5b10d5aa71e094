"""What the camera of a run saw: frames of a replayed episode, from the camera the policy was given."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from schemas.errors import ArtifactError, ConfigError, unknown_choice
from schemas.images import ImageFormat
from stages.replay.logs import LoggedEpisode
from stages.sim.camera import CameraPose, Intrinsics, intrinsics, misaligned, nominal_pose
from stages.sim.config import CameraConfig, MisalignmentKind

_LOSSLESS_UP_TO = 128  # [pixels]; 200 such frames are 5 MB


@dataclass(frozen=True)
class View:
    """What a replay is shown from; None: as in the run."""

    image_size: int | None = None  # [pixels]
    misalignment_kind: MisalignmentKind | None = None
    misalignment_deg: float | None = None
    camera: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `CameraConfig` that are others than the estimator's."""


AS_THE_RUN = View()


@dataclass(frozen=True)
class Camera:
    """A camera that stands still during an episode: the nominal one of `config`, misaligned."""

    config: CameraConfig
    pose: CameraPose
    misalignment_kind: MisalignmentKind
    misalignment_deg: float

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the whole image."""
        return intrinsics(self.config)

    @property
    def misalignment(self) -> str:
        """In words: pan 5°."""
        return f"{self.misalignment_kind} {self.misalignment_deg:g}°"

    @property
    def image_format(self) -> ImageFormat:
        """Of its frames: exact up to 128² pixels, JPEG above."""
        return "png" if self.config.image_size <= _LOSSLESS_UP_TO else "jpeg"


def run_camera(logged: LoggedEpisode, view: View = AS_THE_RUN, otherwise: Mapping[str, Any] = {}) -> Camera:
    """The camera the run's estimates were made from: the estimator's nominal one, misaligned as the run says.

    A run without estimator (oracle) had no camera: it is shown from `otherwise`, fields of `CameraConfig`, by default
    from the default one. `view` overrides image size, misalignment and the camera's fields.

    Raises:
        ArtifactError: the run's estimator is gone or damaged.
        ConfigError: the view is of no camera that could be.
    """
    config, identity = _changed(_nominal(logged, otherwise), view), logged.manifest.config["run"]
    kind = view.misalignment_kind or identity["misalignment_kind"]
    degrees = float(identity["misalignment_deg"] if view.misalignment_deg is None else view.misalignment_deg)
    return Camera(config, misaligned(nominal_pose(config), kind, degrees, np.array(config.target)), kind, degrees)


def _changed(config: CameraConfig, view: View) -> CameraConfig:
    changes = {**view.camera, **({} if view.image_size is None else {"image_size": view.image_size})}
    try:
        return CameraConfig.model_validate(config.model_dump() | changes)
    except ValidationError as error:
        problem = error.errors()[0]
        key = ".".join(map(str, problem["loc"]))
        if problem["type"] == "extra_forbidden":
            raise ConfigError(unknown_choice("camera setting", key, CameraConfig.model_fields)) from error
        raise ConfigError(f"camera setting {key}: {problem['msg']}") from error


def _nominal(logged: LoggedEpisode, otherwise: Mapping[str, Any]) -> CameraConfig:
    name = logged.manifest.config.get("estimator")
    if name is None:
        return CameraConfig.model_validate(otherwise)
    data_root = logged.run_dir.resolve().parents[2]
    return estimator_camera(data_root / "estimators" / name)


def estimator_camera(estimator: Path) -> CameraConfig:
    """The nominal camera an estimator was trained with.

    Raises:
        ArtifactError: the estimator is gone or damaged.
    """
    path = estimator / "estimator.json"
    try:
        return CameraConfig.model_validate(json.loads(path.read_bytes())["camera"])
    except OSError as error:
        raise ArtifactError(f"estimator {estimator.name} is gone: {path} cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, TypeError, ValidationError) as error:
        raise ArtifactError(f"{path} is damaged: it names no camera ({error})") from error
