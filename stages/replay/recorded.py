"""Frames that were recorded with an episode while it was made."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schemas import mcap_files, mcap_topics
from schemas.errors import ArtifactError
from stages.replay.frames import Camera
from stages.replay.logs import LoggedEpisode
from stages.sim.camera import CameraPose
from stages.sim.config import CameraConfig


class Recorded(NamedTuple):
    """What was recorded of an episode while it was made: the camera, and PNG frames after each action."""

    camera: Camera
    frames: list[bytes]


def read_recording(logged: LoggedEpisode, path: Path) -> Recorded:
    """The recorded frames of an episode.

    Raises:
        ArtifactError: the recording is damaged, or of another number of steps.
    """
    topics = (mcap_topics.CAMERA_IMAGE, mcap_topics.CAMERA_CALIBRATION, mcap_topics.TF)
    found: dict[str, list[Any]] = {topic: [] for topic in topics}
    for topic, _, message in mcap_files.read_messages(path, *topics):
        found[topic].append(message)
    images, calibrations, transforms = found.values()
    if not len(images) == len(calibrations) == len(transforms) == logged.steps + 1:
        raise ArtifactError(f"{path} has {len(images)} frames, its episode {logged.steps} steps: it is damaged")
    return Recorded(_recorded_camera(logged, calibrations[0], transforms[0]), [image.data for image in images[1:]])


def _recorded_camera(logged: LoggedEpisode, calibration: Any, transforms: Any) -> Camera:
    position, quaternion = mcap_topics.placement(transforms, mcap_topics.CAMERA_FRAME)
    pose = CameraPose.from_quaternion(position, quaternion)
    size, focal_length = calibration.height, calibration.K[4]  # [pixels]
    fovy = float(np.degrees(2.0 * np.arctan2(0.5 * size, focal_length)))
    run = logged.manifest.config["run"]
    config = CameraConfig(image_size=size, fovy=fovy, position=tuple(position.tolist()))
    return Camera(config, pose, run["misalignment_kind"], float(run["misalignment_deg"]))
