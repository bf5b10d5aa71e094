"""An episode of a dataset as a track, from its MCAP file alone but for the robot's meshes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from schemas import mcap_topics
from schemas.errors import ArtifactError
from schemas.manifest import read_manifest
from schemas.mcap_files import read_messages, read_metadata
from stages.replay.track import Actions, Clock, EpisodeTrack, Pose
from stages.sim.camera import CameraPose, Intrinsics
from stages.sim.config import WorldConfig
from stages.sim.renderer import LinkMesh, link_meshes
from stages.sim.scene import build_scene

_STEP_NS = 50_000_000  # SPEC §3: 20 Hz


def dataset_track(dataset: Path, episode: int) -> EpisodeTrack:
    """The kept frames of an episode; row k is a frame and the state it shows.

    Raises:
        ArtifactError: no such dataset or episode, or one of them is damaged.
    """
    meshes = _meshes(dataset)
    path = episode_file(dataset, episode)
    metadata = read_metadata(path)
    if metadata.get("episode") != str(episode):
        raise ArtifactError(f"{path} is of episode {metadata.get('episode')}: put it back, or collect it again")
    by_time = _messages_by_time(path)
    frames = {at: messages for at, messages in by_time.items() if mcap_topics.CAMERA_IMAGE in messages}
    if not frames:
        raise ArtifactError(f"{path} has no frames: collect it again")
    clock = _clock(list(frames))
    messages = list(frames.values())
    calibration = messages[0][mcap_topics.CAMERA_CALIBRATION]
    return EpisodeTrack(
        name=f"{dataset.name} episode {episode}",
        description=_description(f"{dataset.name}, {path.stem}", metadata, len(frames)),
        clock=clock,
        cube=_cube(messages),
        links={link: _pose(messages, link) for link in dict.fromkeys(mesh.link for mesh in meshes)},
        meshes=meshes,
        camera=CameraPose.from_quaternion(
            *mcap_topics.placement(messages[0][mcap_topics.TF], mcap_topics.CAMERA_FRAME)
        ),
        intrinsics=Intrinsics(calibration.width, calibration.K[0]),
        images=[message[mcap_topics.CAMERA_IMAGE].data for message in messages],
        media_type=f"image/{messages[0][mcap_topics.CAMERA_IMAGE].format}",
        joints=np.array([[j.position for j in message[mcap_topics.ROBOT_JOINTS].joints] for message in messages]),
        actions=_actions(by_time),
    )


def episode_file(dataset: Path, episode: int) -> Path:
    """The MCAP file of an episode.

    Raises:
        ArtifactError: there is none; names those that there are.
    """
    path = dataset / "episodes" / f"episode-{episode:06d}.mcap"
    if not path.is_file():
        count = len(list(path.parent.glob("episode-*.mcap")))
        there = f"it has {count}, from 0 to {count - 1}" if count else "it has none"
        raise ArtifactError(f"no episode {episode} in {dataset}; {there}")
    return path


def _meshes(dataset: Path) -> list[LinkMesh]:
    manifest = read_manifest(dataset)
    if manifest.stage != "collect":
        raise ArtifactError(f"{dataset} is an artifact of {manifest.stage}, not a dataset")
    try:
        return link_meshes(build_scene(WorldConfig.model_validate(manifest.config["world"])))
    except (KeyError, ValidationError) as error:
        raise ArtifactError(f"{dataset}/manifest.json describes no known world: {error}") from error


def _messages_by_time(path: Path) -> dict[int, dict[str, Any]]:
    by_time: dict[int, dict[str, Any]] = {}
    for topic, time_ns, message in read_messages(path):
        by_time.setdefault(time_ns, {})[topic] = message
    return by_time


def _clock(times: list[int]) -> Clock:
    time_ns = np.array(times, dtype=np.int64)
    return Clock(time_ns, np.rint(time_ns / _STEP_NS).astype(np.int64))


def _pose(messages: list[dict[str, Any]], child: str) -> Pose:
    placements = [mcap_topics.placement(message[mcap_topics.TF], child) for message in messages]
    return Pose(np.array([position for position, _ in placements]), np.array([turn for _, turn in placements]))


def _cube(messages: list[dict[str, Any]]) -> Pose:
    poses = [message[mcap_topics.CUBE_POSE].pose for message in messages]
    return Pose(
        np.array([[p.position.x, p.position.y, p.position.z] for p in poses]),
        np.array([[p.orientation.w, p.orientation.x, p.orientation.y, p.orientation.z] for p in poses]),
    )


def _actions(by_time: dict[int, dict[str, Any]]) -> Actions:
    found = {
        at: messages[mcap_topics.ACTION].values for at, messages in by_time.items() if mcap_topics.ACTION in messages
    }
    return Actions(_clock(list(found)), np.array(list(found.values())))


def _description(shown_as: str, metadata: dict[str, str], frames: int) -> str:
    shown = ("task", "behaviour", "split", "seed", "success", "camera_translation", "camera_rotation")
    rows = [f"| {name.replace('_', ' ')} | {_short(metadata[name])} |" for name in shown if name in metadata]
    title = [f"# {shown_as}", f"{frames} frames kept of {metadata.get('steps', '?')} steps"]
    return "\n".join([*title, "\n| | |\n|---|---|", *rows])


def _short(text: str) -> str:
    """JSON lists of numbers with four decimals; everything else as it is."""
    value = json.loads(text) if text.startswith("[") else text
    return ", ".join(f"{number:.4f}" for number in value) if isinstance(value, list) else text
