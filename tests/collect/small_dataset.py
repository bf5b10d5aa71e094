"""Small configurations, and readers of what collect writes."""

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from pipeline.artifacts.manifests import list_files
from schemas import mcap_topics
from schemas.manifest import Code, Environment, Manifest, config_sha256
from schemas.mcap_files import read_messages
from stages.collect.config import CollectConfig, CollectStageConfig
from stages.collect.plan import plan_episodes
from stages.sim.camera import CameraPose
from stages.sim.config import CameraConfig
from stages.sim.state import STATE_DTYPE

DATASET = "small"
CONFIG = CollectStageConfig(
    camera=CameraConfig(image_size=128),
    collect=CollectConfig(episodes=4, steps=40, random_fraction=0.5, leaning_fraction=0.25, workers=1),
)
TINY = CollectConfig(episodes=3, steps=8, keep_fraction=0.5, random_fraction=0.3, workers=1)
PLANS = plan_episodes(CONFIG.collect, "scripted")
CORNERS = np.array(list(itertools.product([-0.025, 0.025], repeat=3)))  # (8, 3) [m] of the cube, in its frame


def tiny(**changes: Any) -> CollectStageConfig:
    """Three episodes of eight steps at 32 pixels, four frames each."""
    return CollectStageConfig(camera=CameraConfig(image_size=32), collect=TINY.model_copy(update=changes))


def write_manifest(out: Path, config: CollectStageConfig, summary: dict[str, Any]) -> None:
    """A manifest such as the pipeline writes."""
    manifest = Manifest(
        id=f"datasets/{out.name}",
        stage="collect",
        name=out.name,
        status="complete",
        created_at="2025-01-01T00:00:00Z",
        config=config.model_dump(mode="json"),
        config_sha256=config_sha256(config.model_dump(mode="json")),
        inputs=[],
        code=Code(version="0", git_commit=None, dirty=None),
        environment=Environment(python="", platform="", cpu="", gpu=None, gl_renderer=None, packages={}),
        files=list_files(out),
        summary=summary,
    )
    (out / "manifest.json").write_text(manifest.model_dump_json())


def blank_state() -> Any:
    """A state of zeros, to fill in."""
    return np.zeros((), STATE_DTYPE)


def episode_files(dataset: Path) -> list[Path]:
    """The dataset's MCAP files in order."""
    return sorted((dataset / "episodes").iterdir())


def frames(path: Path) -> list[dict[str, Any]]:
    """Messages by topic of each time at which there is an image."""
    by_time: dict[int, dict[str, Any]] = {}
    for topic, time_ns, message in read_messages(path):
        by_time.setdefault(time_ns, {})[topic] = message
    return [messages for messages in by_time.values() if mcap_topics.CAMERA_IMAGE in messages]


def decode(message: Any) -> np.ndarray:
    """The picture (H, W, 3) uint8 of a CompressedImage."""
    return np.asarray(Image.open(io.BytesIO(message.data)))


def cube_box(messages: dict[str, Any], camera: CameraPose | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Where the messages say the cube is in the image: its centre (2,), its bounding box (4,) [pixels].

    By the file's own calibration and transforms, or seen by `camera`.
    """
    tf, matrix = messages[mcap_topics.TF], np.reshape(messages[mcap_topics.CAMERA_CALIBRATION].K, (3, 3))
    camera = camera or CameraPose.from_quaternion(*mcap_topics.placement(tf, "camera"))
    position, quaternion = mcap_topics.placement(tf, "cube")
    corners = position + Rotation.from_quat(quaternion, scalar_first=True).apply(CORNERS)
    homogeneous = (np.vstack([position, corners]) - camera.position) @ camera.rotation @ matrix.T  # (9, 3)
    pixels = homogeneous[:, :2] / homogeneous[:, 2:]
    return pixels[0], np.concatenate([pixels[1:].min(axis=0), pixels[1:].max(axis=0)])


def red_pixels(image: np.ndarray) -> np.ndarray:
    """Mask (H, W) of the cube, the only red thing in the scene."""
    red, green = image[..., 0].astype(float), image[..., 1].astype(float)
    return (red > 1.5 * green) & (red > 40)


def bounding_box(mask: np.ndarray) -> np.ndarray:
    """(left, top, right, bottom) of the mask's pixels, as edges [pixels]."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])


def hides_nothing(episode: int, messages: dict[str, Any]) -> bool:
    """Whether arm and hand are surely not between camera and cube: upright, and 15 cm away."""
    return not PLANS[episode].leaning and gripper_distance(messages) > 0.15


def gripper_distance(messages: dict[str, Any]) -> float:
    """Between the hand and the cube [m]."""
    tf = messages[mcap_topics.TF]
    hand, cube = (mcap_topics.placement(tf, frame)[0] for frame in ("gripper0_right_eef", "cube"))
    return float(np.linalg.norm(hand - cube))
