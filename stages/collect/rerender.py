"""Renders kept frames again from a misaligned camera (SPEC §3): same states, another view."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from schemas import mcap_topics
from schemas.datasets import FrameRef, Rerender
from schemas.errors import ArtifactError
from schemas.manifest import MANIFEST, read_manifest
from schemas.mcap_files import read_messages
from stages.collect.config import CollectStageConfig
from stages.sim.camera import misaligned, nominal_pose
from stages.sim.renderer import Renderer
from stages.sim.scene import build_scene


def make_rerender(dataset: Path) -> Rerender:
    """Re-renderer of the dataset in that directory, with its own world and nominal camera.

    Raises:
        ArtifactError: the directory's manifest is missing, damaged or no dataset's.
    """
    config = _read_config(dataset)

    def rerender(frames: Sequence[FrameRef], kind: str, degrees: float) -> Iterator[np.ndarray]:
        pivot = np.array(config.camera.target)
        pose = misaligned(nominal_pose(config.camera), kind, degrees, pivot)
        with Renderer(build_scene(config.world), config.camera.image_size, config.camera.fovy) as renderer:
            for qpos in _states(dataset, frames):
                yield renderer.render(qpos, pose)

    return rerender


def _read_config(dataset: Path) -> CollectStageConfig:
    manifest = read_manifest(dataset)
    try:
        sections = {name: manifest.config[name] for name in CollectStageConfig.model_fields}
        return CollectStageConfig.model_validate(sections)
    except (KeyError, ValidationError) as error:
        raise ArtifactError(f"{dataset / MANIFEST} is no dataset's: {error}; collect the dataset again") from error


def _states(dataset: Path, frames: Sequence[FrameRef]) -> Iterator[np.ndarray]:
    """Generalised positions (nq,) of each frame, in order; each run of frames of one file is one pass over it."""
    for file, of_file in groupby(frames, key=lambda frame: frame.file):
        path = dataset / file
        positions = {time_ns: message.qpos for _, time_ns, message in read_messages(path, mcap_topics.SIM_STATE)}
        for frame in of_file:
            if frame.time_ns not in positions:
                raise ArtifactError(f"{path} has no {mcap_topics.SIM_STATE} at {frame.time_ns} ns: collect it again")
            yield np.array(positions[frame.time_ns])
