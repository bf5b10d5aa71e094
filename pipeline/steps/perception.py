"""train-perception → estimators/NAME."""

from pathlib import Path
from typing import Any

from pipeline import interrupts
from pipeline.artifacts.inputs import load
from pipeline.artifacts.space import require_space
from pipeline.artifacts.store import Build, Request
from pipeline.machine import require_device
from pipeline.steps.session import Outcome, Session, make
from schemas.errors import ArtifactError, ConfigError
from schemas.integrity import file_sha256
from stages.perception.config import PerceptionStageConfig

SPACE_NEEDED = 3 * 350_000_000 + 100_000_000
"""Bytes of three checkpoints (weights, best weights, two moments of the optimizer) and of the estimator."""


def request(session: Session, name: str, dataset: str, weights: Path | None = None) -> Request:
    """The estimator asked for. Initial weights are part of its identity by their hash."""
    config = PerceptionStageConfig(perception=session.config.perception).model_dump(mode="json")
    config["weights_sha256"] = _weights_sha256(weights) if weights else None
    defaults = PerceptionStageConfig().model_dump(mode="json")
    device = session.config.perception.device
    return Request(f"estimators/{name}", config, [session.pin(f"datasets/{dataset}")], defaults, device)


def _weights_sha256(weights: Path) -> str:
    try:
        return file_sha256(weights)
    except OSError as error:
        takes = "--weights takes a safetensors file with torchvision's keys"
        raise ArtifactError(f"no weights file {weights} ({error.strerror}): {takes}") from error


def require_robot(session: Session, estimator: str) -> None:
    """ConfigError when an estimator saw another robot than the one to train; not known once its dataset is gone."""
    made_from = load(session.root, f"estimators/{estimator}").inputs
    seen = next((ref.id for ref in made_from if session.store.path(ref.id).exists()), None)
    if seen is None:
        return
    robot, wanted = load(session.root, seen).config["world"]["robot"], session.config.world.robot
    if robot != wanted:
        raise ConfigError(
            f"estimators/{estimator} learned from images of {robot} ({seen}), but world.robot is {wanted}: "
            f"use --set world.robot={robot}, or an estimator of {wanted}"
        )


def train_perception(session: Session, name: str, dataset: str, weights: Path | None = None) -> Outcome:
    """Train an estimator on a dataset."""
    directory = session.store.path(f"datasets/{dataset}")

    def stage(build: Build) -> dict[str, Any]:
        require_device(session.config.perception.device)
        if not build.resumed:
            require_space(session.root, SPACE_NEEDED)
        from stages.collect.rerender import make_rerender
        from stages.perception.training import run

        with interrupts.finishing():
            return run(
                session.config.perception,
                directory,
                build.path,
                estimator=name,
                weights=weights,
                rerender=make_rerender(directory),
                progress=session.progress,
            )

    return make(session, request(session, name, dataset, weights), stage, renders=True)
