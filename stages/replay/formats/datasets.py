"""Episodes of a camera dataset: its kept frames, with the joints, the cube and the action of the same moment."""

import io
from collections.abc import Generator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from schemas import mcap_topics
from schemas.errors import ArtifactError, ConfigError
from schemas.files import read_parquet
from schemas.manifest import read_manifest
from schemas.mcap_files import TOPICS, read_messages, read_metadata
from schemas.tables import FRAMES
from stages.replay.formats.episodes import ENVIRONMENT_STATE, IMAGE, STATE, Episode, Source
from stages.replay.parquet import check_schema
from stages.sim.config import action_dim

SPLITS = ("train", "validation", "test")
_CLOSED = 1.0  # the gripper's command; in reach it stays closed and is no part of the action


def dataset_source(dataset: Path, split: str | None, limit: int | None, images: bool) -> Source:
    """Episodes of the dataset in `dataset`: of one split or of all, at most `limit`.

    A dataset keeps a part of the steps only, with everything that is seen of them; the other steps have an action and
    nothing else. An exported episode is its kept steps in order, `Episode.steps` saying which they are: pairs of what
    was seen and done, without the transition between them, and without rewards.

    Raises:
        ArtifactError: it is no dataset, or damaged.
        ConfigError: it has no such episode.
    """
    manifest = read_manifest(dataset)
    if manifest.stage != "collect":
        raise ArtifactError(f"{dataset} is an artifact of {manifest.stage}, not a dataset")
    files = _files(dataset, split)
    if not files:
        raise ConfigError(f"{manifest.id} has no episode of the split {split}; there: {', '.join(SPLITS)}")
    total = len(files) if limit is None else min(limit, len(files))
    topics = [topic for topic in TOPICS if images or topic != mcap_topics.CAMERA_IMAGE]
    width = max(action_dim(task) for task in ("reach", *manifest.config.get("collect", {}).get("tasks", ())))

    def read() -> Generator[Episode, None, None]:
        for file, of, number in islice(files, total):
            yield _episode(dataset / file, of, number, topics, width)

    world = manifest.config["world"]
    return Source(manifest.id, str(world["robot"]), world, has_rewards=False, total=total, read=read)


def _files(dataset: Path, split: str | None) -> list[tuple[str, str, int]]:
    """(file, split, episode) of every episode, in order."""
    path = dataset / "frames.parquet"
    table = read_parquet(path, missing=f"{dataset} has no table of frames")
    check_schema(table.schema, FRAMES, path)
    rows = table.select(["file", "split", "episode"]).to_pylist()
    found = dict.fromkeys((row["file"], row["split"], row["episode"]) for row in rows)
    return [each for each in found if split in (None, each[1])]


def _episode(path: Path, split: str, number: int, topics: list[str], width: int) -> Episode:
    kept = _kept(path, topics)
    actions = np.array([_padded(each[mcap_topics.ACTION].values, width) for each in kept], np.float32)
    observations = {
        STATE: np.array([_joints(each) for each in kept], np.float32),
        ENVIRONMENT_STATE: np.array([_cube(each) for each in kept], np.float32),
    }
    if mcap_topics.CAMERA_IMAGE in topics:
        observations[IMAGE] = np.stack([_decoded(path, each[mcap_topics.CAMERA_IMAGE].data) for each in kept])
    ends = np.arange(len(kept)) == len(kept) - 1
    return Episode(
        task=read_metadata(path).get("task", "reach"),
        split=split,
        number=number,
        steps=np.array([each[mcap_topics.ACTION].step for each in kept], np.int64),
        observations=observations,
        actions=actions,
        rewards=np.zeros(len(kept), np.float32),
        signals={},
        terminated=np.zeros(len(kept), bool),
        truncated=ends,
    )


def _kept(path: Path, topics: list[str]) -> list[dict[str, Any]]:
    """Messages by topic of every step that has both a frame and an action."""
    by_time: dict[int, dict[str, Any]] = {}
    for topic, time_ns, message in read_messages(path, *topics):
        by_time.setdefault(time_ns, {})[topic] = message
    whole = {mcap_topics.CUBE_POSE, mcap_topics.ACTION}  # only kept steps have the cube's pose
    kept = [messages for messages in by_time.values() if whole <= messages.keys()]
    if not kept:
        raise ArtifactError(f"{path} has no frames: collect it again")
    return kept


def _padded(values: Any, width: int) -> list[float]:
    """An action of reach among those of lift says what its gripper did."""
    return [*values, *[_CLOSED] * (width - len(values))]


def _joints(messages: dict[str, Any]) -> list[float]:
    """Positions [rad], then velocities [rad/s]."""
    joints = messages[mcap_topics.ROBOT_JOINTS].joints
    return [*(joint.position for joint in joints), *(joint.velocity for joint in joints)]


def _cube(messages: dict[str, Any]) -> list[float]:
    """Position in the world [m], then the quaternion (w, x, y, z)."""
    pose = messages[mcap_topics.CUBE_POSE].pose
    position, turn = pose.position, pose.orientation
    return [position.x, position.y, position.z, turn.w, turn.x, turn.y, turn.z]


def _decoded(path: Path, data: bytes) -> np.ndarray:
    try:
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises for damaged PNG and JPEG
        raise ArtifactError(f"{path}: an image cannot be decoded; collect again") from error
