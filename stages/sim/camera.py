"""Camera geometry: poses, domain randomisation, misalignment, projection. Arithmetic only, nothing of a scene.

Frames: the optical frame has x right, y down, z forward (OpenCV, Foxglove). Image coordinates put (0, 0) on the outer
corner of the top-left pixel, so pixel i covers [i, i + 1) and the principal point of a centred camera is size / 2.
"""

from dataclasses import dataclass

import numpy as np

from schemas.errors import unknown_choice
from stages.sim.config import CameraConfig
from stages.sim.rotation import matrix_about, matrix_of, matrix_of_vector, quaternion_of

WORLD_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class CameraPose:
    """T_world_camera: optical frame in the world."""

    position: np.ndarray  # (3,) [m]
    rotation: np.ndarray  # (3, 3), columns are the camera's right, down and forward axes in the world

    @property
    def quaternion(self) -> np.ndarray:
        """Orientation as (w, x, y, z), w ≥ 0."""
        return quaternion_of(self.rotation)

    @staticmethod
    def from_quaternion(position: np.ndarray, quaternion: np.ndarray) -> "CameraPose":
        """Inverse of `position, quaternion`; `quaternion` is (w, x, y, z)."""
        return CameraPose(np.asarray(position), matrix_of(quaternion))


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole with square pixels and image, no distortion."""

    size: int  # width and height [pixels]
    focal: float  # [pixels]

    @property
    def centre(self) -> float:
        """Principal point, the same in x and y [pixels]."""
        return self.size / 2

    @property
    def matrix(self) -> np.ndarray:
        """Calibration matrix K (3, 3)."""
        return np.array([[self.focal, 0, self.centre], [0, self.focal, self.centre], [0, 0, 1]])


def intrinsics(config: CameraConfig) -> Intrinsics:
    """Intrinsics of the configured camera: tan(fovy / 2) = (size / 2) / focal."""
    return Intrinsics(config.image_size, config.image_size / 2 / np.tan(np.radians(config.fovy) / 2))


def nominal_pose(config: CameraConfig) -> CameraPose:
    """Camera at `position`, looking at `target`, image upright (world z up)."""
    position = np.array(config.position)
    forward = np.array(config.target) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, WORLD_UP)
    if np.linalg.norm(right) < 1e-9:  # straight down: the image's right is the world's −y, as from behind the robot
        right = np.array([0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    return CameraPose(position, np.stack([right, np.cross(forward, right), forward], axis=1))


def displaced(pose: CameraPose, rng: np.random.Generator, translation: float, rotation_deg: float) -> CameraPose:
    """Domain randomisation (paper §IV): uniform shift [m] and rotation [degrees] about each camera axis."""
    shift = rng.uniform(-translation, translation, 3)
    angles = rng.uniform(-rotation_deg, rotation_deg, 3)
    return CameraPose(pose.position + shift, pose.rotation @ matrix_of_vector(np.radians(angles)))


def misaligned(pose: CameraPose, kind: str, degrees: float, pivot: np.ndarray) -> CameraPose:
    """Camera turned by `degrees` (SPEC §3).

    pan: in place, about the camera's own vertical axis. orbit: on an arc about the world's vertical through `pivot`
    [m], so that the camera still looks at it.

    Raises:
        ValueError: `kind` is neither.
    """
    if kind == "pan":
        return CameraPose(pose.position, pose.rotation @ matrix_about(np.array([0.0, 1.0, 0.0]), np.radians(degrees)))
    if kind == "orbit":
        turn = matrix_about(WORLD_UP, np.radians(degrees))
        return CameraPose(pivot + turn @ (pose.position - pivot), turn @ pose.rotation)
    raise ValueError(unknown_choice("misalignment", kind, ("pan", "orbit")))


def project(points: np.ndarray, pose: CameraPose, camera: Intrinsics) -> np.ndarray:
    """World points (n, 3) [m] → image coordinates (n, 2) [pixels]."""
    local = (points - pose.position) @ pose.rotation  # (n, 3) in the optical frame
    return camera.focal * local[:, :2] / local[:, 2:] + camera.centre


def unproject(pixels: np.ndarray, depth: np.ndarray, pose: CameraPose, camera: Intrinsics) -> np.ndarray:
    """Image coordinates (n, 2) [pixels] at depth (n,) [m] along the optical axis → world points (n, 3) [m]."""
    rays = np.concatenate([(pixels - camera.centre) / camera.focal, np.ones((len(pixels), 1))], axis=1)
    return pose.position + (rays * depth[:, None]) @ pose.rotation.T
