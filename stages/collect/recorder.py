"""Writes an episode to its MCAP file (SPEC §4)."""

import hashlib
import json
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import cast

import numpy as np
from mcap_protobuf.writer import Writer

from schemas import mcap_files, mcap_topics
from schemas.images import encode
from schemas.mcap_frames import CameraView, frame_messages
from schemas.tables import SCHEMA_VERSION
from stages.collect.config import CollectStageConfig
from stages.collect.plan import EpisodePlan
from stages.collect.simulate import Episode, Snapshot
from stages.sim.camera import CameraPose, intrinsics, nominal_pose
from stages.sim.renderer import Renderer
from stages.sim.rotation import vector_of

_VERSIONED = ("mujoco", "robosuite", "numpy")


class Recorder:
    """Renders and records episodes of one dataset."""

    def __init__(self, config: CollectStageConfig, renderer: Renderer, joint_names: tuple[str, ...]) -> None:
        self._config, self._renderer, self._joint_names = config, renderer, joint_names
        self._intrinsics = intrinsics(config.camera).matrix
        self._transforms: mcap_topics.FrameTransforms | None = None  # filled in anew for each frame

    def record(self, path: Path, plan: EpisodePlan, episode: Episode, camera: CameraPose) -> None:
        """Write the whole file; it appears at `path` only when complete, and is durable after `make_durable`."""
        kept = {snapshot.step: snapshot for snapshot in episode.kept}
        metadata = episode_metadata(self._config, plan, episode, camera)
        placement = camera.position, camera.quaternion
        with mcap_files.create(path, self._config.collect.compression, durable=False) as writer:
            writer.add_metadata(mcap_topics.EPISODE_METADATA, metadata)
            for step, time_ns in enumerate(episode.times_ns):
                if step in kept:
                    picture = self._renderer.render(kept[step].qpos, camera)
                    self._write_frame(writer, time_ns, kept[step], picture, placement)
                if step in kept or step == 0:
                    _write_state(writer, time_ns, kept.get(step, episode.initial))
                action = mcap_topics.action(time_ns, step, episode.actions[step])
                mcap_files.write(writer, mcap_topics.ACTION, time_ns, action)

    def _write_frame(
        self, writer: Writer, time_ns: int, snapshot: Snapshot, picture: np.ndarray, camera: mcap_topics.Placement
    ) -> None:
        image_format = self._config.collect.image_format
        view = CameraView(camera, self._config.camera.image_size, self._intrinsics, image_format)
        data = encode(picture, image_format, chunked=True)
        messages = frame_messages(view, data, snapshot.state, self._joint_names, snapshot.links, self._transforms)
        self._transforms = cast(mcap_topics.FrameTransforms, messages[mcap_topics.TF])
        for topic, message in messages.items():
            mcap_files.write(writer, topic, time_ns, message)


def episode_metadata(
    config: CollectStageConfig, plan: EpisodePlan, episode: Episode, camera: CameraPose
) -> dict[str, str]:
    """What the file's `episode` metadata record says; values that are not words are JSON."""
    nominal = nominal_pose(config.camera)
    turn = np.degrees(vector_of(nominal.rotation.T @ camera.rotation))
    return {
        **plan.identity,
        "steps": str(len(episode.times_ns)),
        "kept_steps": json.dumps(plan.kept_steps),
        "success": json.dumps(episode.success),
        "robot": config.world.robot,
        "camera_translation": json.dumps((camera.position - nominal.position).tolist()),  # [m], world axes
        "camera_rotation": json.dumps(turn.tolist()),  # rotation vector [degrees], nominal camera's axes
        "config_sha256": config_sha256(config),
        "schema_version": str(SCHEMA_VERSION),
        "versions": _versions(),
    }


@lru_cache
def _versions() -> str:
    return json.dumps({package: version(package) for package in _VERSIONED})


@lru_cache
def config_sha256(config: CollectStageConfig) -> str:
    """Hash of all that the episodes depend on: not of where they are made."""
    identity = config.model_dump(mode="json", exclude={"collect": {"workers"}})
    return hashlib.sha256(json.dumps(identity, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _write_state(writer: Writer, time_ns: int, snapshot: Snapshot) -> None:
    message = mcap_topics.sim_state(time_ns, snapshot.step, snapshot.integration_state, snapshot.qpos)
    mcap_files.write(writer, mcap_topics.SIM_STATE, time_ns, message)
