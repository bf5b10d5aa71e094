"""Reads an episode file back as rows of frames.parquet: what is on disk is what the table says."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas import mcap_topics
from schemas.errors import ArtifactError
from schemas.mcap_files import read_messages, read_metadata
from stages.collect.plan import EpisodePlan


@dataclass(frozen=True)
class EpisodeResult:
    """A finished episode: its frames' rows, and what the summary counts."""

    plan: EpisodePlan
    rows: list[dict[str, Any]]  # of schemas.tables.FRAMES
    success: bool
    bytes: int


def read_episode(path: Path, plan: EpisodePlan, dataset: str, config_sha256: str) -> EpisodeResult:
    """Rows of the file at `path`, every message of it decoded.

    Raises:
        ArtifactError: it is missing, damaged, made from another configuration, another episode's, or lacks frames.
    """
    metadata = read_metadata(path)
    if metadata.get("config_sha256") != config_sha256:
        raise ArtifactError(f"{path} was collected with another configuration")
    if not plan.identity.items() <= metadata.items():
        raise ArtifactError(f"{path} is another episode's")
    rows = _rows(path, plan, dataset)
    if tuple(row["step"] for row in rows) != plan.kept_steps:
        raise ArtifactError(f"{path} lacks frames")
    return EpisodeResult(plan, rows, json.loads(metadata["success"]), path.stat().st_size)


def _rows(path: Path, plan: EpisodePlan, dataset: str) -> list[dict[str, Any]]:
    by_time: dict[int, dict[str, Any]] = {}
    for topic, time_ns, message in read_messages(path):
        by_time.setdefault(time_ns, {})[topic] = message
    return [
        _row(time_ns, messages, plan, dataset)
        for time_ns, messages in by_time.items()
        if mcap_topics.CAMERA_IMAGE in messages
    ]


def _row(time_ns: int, messages: dict[str, Any], plan: EpisodePlan, dataset: str) -> dict[str, Any]:
    cube = messages[mcap_topics.CUBE_POSE].pose.position
    position, quaternion = mcap_topics.placement(messages[mcap_topics.TF], mcap_topics.CAMERA_FRAME)
    return {
        "dataset": dataset,
        "episode": plan.episode,
        "step": messages[mcap_topics.SIM_STATE].step,
        "time_ns": time_ns,
        "file": plan.file,
        "split": plan.split,
        "behaviour": plan.behaviour,
        "cube_x": cube.x,
        "cube_y": cube.y,
        "cube_z": cube.z,
        **{f"camera_{axis}": value for axis, value in zip("xyz", position, strict=True)},
        **{f"camera_q{axis}": value for axis, value in zip("wxyz", quaternion, strict=True)},
    }
