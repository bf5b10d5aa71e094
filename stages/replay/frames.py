"""What the camera of a run saw: frames of a replayed episode, from the camera the policy was given."""

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from pydantic import ValidationError

from schemas.errors import ArtifactError
from stages.replay.logs import LoggedEpisode
from stages.sim.camera import CameraPose, Intrinsics, intrinsics, misaligned, nominal_pose
from stages.sim.config import CameraConfig

_LOSSLESS_UP_TO = 128  # [pixels]; 200 such frames are 5 MB
_JPEG_QUALITY = 92


@dataclass(frozen=True)
class Camera:
    """A camera that stands still during an episode."""

    config: CameraConfig
    pose: CameraPose

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the whole image."""
        return intrinsics(self.config)


def run_camera(logged: LoggedEpisode, image_size: int | None = None) -> Camera:
    """The camera the run's estimates were made from: the estimator's nominal one, misaligned as the run says.

    A run without estimator (oracle) had no camera: it is shown from the default one. `image_size` [pixels] overrides
    the estimator's.

    Raises:
        ArtifactError: the run's estimator is gone or damaged.
    """
    config = _nominal(logged)
    if image_size is not None:
        config = config.model_copy(update={"image_size": image_size})
    identity = logged.manifest.config["run"]
    pose = misaligned(
        nominal_pose(config),
        identity["misalignment_kind"],
        float(identity["misalignment_deg"]),
        np.array(config.target),
    )
    return Camera(config, pose)


def _nominal(logged: LoggedEpisode) -> CameraConfig:
    name = logged.manifest.config.get("estimator")
    if name is None:
        return CameraConfig()
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


def encode(image: np.ndarray) -> tuple[bytes, str]:
    """An image (H, W, 3) uint8 and its media type: exact while that is small, JPEG from 256² on."""
    buffer = io.BytesIO()
    if image.shape[0] <= _LOSSLESS_UP_TO:
        Image.fromarray(image).save(buffer, "png", compress_level=3)
        return buffer.getvalue(), "image/png"
    Image.fromarray(image).save(buffer, "jpeg", quality=_JPEG_QUALITY, subsampling=0)
    return buffer.getvalue(), "image/jpeg"
