"""train-perception → estimators/NAME."""

from pathlib import Path
from typing import Any

from pipeline.artifacts.manifests import file_sha256
from pipeline.artifacts.store import Build, Request
from pipeline.machine import require_device
from pipeline.steps.session import Outcome, Session, make
from schemas.errors import ArtifactError
from stages.perception.config import PerceptionStageConfig


def request(session: Session, name: str, dataset: str, weights: Path | None = None) -> Request:
    """The estimator asked for. Initial weights are part of its identity by their hash."""
    config = PerceptionStageConfig(perception=session.config.perception).model_dump(mode="json")
    config["weights_sha256"] = _weights_sha256(weights) if weights else None
    return Request(f"estimators/{name}", config, [session.pin(f"datasets/{dataset}")])


def _weights_sha256(weights: Path) -> str:
    if not weights.is_file():
        raise ArtifactError(f"no weights file {weights}: --weights takes a safetensors file with torchvision's keys")
    return file_sha256(weights)


def train_perception(session: Session, name: str, dataset: str, weights: Path | None = None) -> Outcome:
    """Train an estimator on a dataset."""
    directory = session.store.path(f"datasets/{dataset}")

    def stage(build: Build) -> dict[str, Any]:
        from stages.collect.rerender import make_rerender
        from stages.perception.training import run

        require_device(session.config.perception.device)
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
