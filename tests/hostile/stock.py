"""One data root with a small artifact of every kind, written by the project's own writers; made once per session."""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from pipeline.artifacts.inputs import input_ref
from pipeline.artifacts.manifests import list_files, write_manifest
from pipeline.artifacts.store import Request, Store
from schemas.manifest import config_sha256, read_manifest
from stages.collect.config import CollectStageConfig
from stages.perception.estimator import EstimatorCard
from stages.perception.normalisation import Normalisation
from stages.policy.config import RunConfig
from stages.sim.config import CameraConfig, WorldConfig
from tests.analyze.fake_artifacts import write_estimator
from tests.analyze.fake_runs import write_run
from tests.pipeline.fakes import begin
from tests.replay.tiny_run import CELL, RUN_NAME, edit_manifest, make_dataset, make_run

DATASET, ESTIMATOR, REPORT = "datasets/tiny", "estimators/resnet", "reports/first"
REPLAYED = f"runs/{RUN_NAME}/{CELL}"
"""A run of the real world, which a replay proves."""
LEARNT = "runs/study/reach-dense2sparse-orbit00-seed0"
"""A run with learning curves and a policy."""


def make_stock(root: Path) -> None:
    """Every artifact of the module's constants, sealed: their manifests list every file."""
    run = make_run(root)
    dataset = make_dataset(run, root / DATASET)
    edit_manifest(dataset, config=CollectStageConfig().model_dump(mode="json"))
    _seal(root, DATASET)
    estimator = write_estimator(root, "resnet", dataset=dataset)
    _write_network(estimator)
    _seal(root, ESTIMATOR, inputs=[DATASET])
    _seal(root, REPLAYED)
    for seed in (0, 1):
        learnt = write_run(root, seed=seed, episodes=40, switch=20, logged_steps=200, estimator=estimator)
        _write_policy(learnt)
        _seal(root, f"runs/study/{learnt.name}", inputs=[ESTIMATOR])
    with begin(Store(root), Request(REPORT, {}, [input_ref(root, LEARNT)])) as build:
        (build.path / "report.html").write_text("<html></html>")
        build.finish({"runs": 1})


def _seal(root: Path, artifact_id: str, inputs: list[str] | None = None) -> None:
    directory = root / artifact_id
    config = json.loads((directory / "manifest.json").read_bytes())["config"]
    if artifact_id.startswith("runs/"):  # the writers know the few keys that their tests need
        config["world"] = WorldConfig().model_dump(mode="json") | config["world"]
        config["policy"] = RunConfig().model_dump(mode="json") | config["policy"]
    pinned = [input_ref(root, each).model_dump() for each in inputs or []]
    seal(directory, inputs=pinned, config=config, config_sha256=config_sha256(config))


def seal(directory: Path, **changes: object) -> None:
    """Let the manifest list the files as they are now, under a seal."""
    edit_manifest(directory, files=[file.model_dump() for file in list_files(directory)], **changes)
    write_manifest(read_manifest(directory), directory)


def _write_network(estimator: Path) -> None:
    """A card as training writes it, and weights of too few layers: what reads them verifies them first."""
    card = EstimatorCard(
        estimator="resnet",
        dataset="tiny",
        image_size=64,
        precision="float32",
        normalisation=Normalisation(
            pixel_mean=(90, 90, 90), pixel_std=(40, 40, 40), target_mean=(0, 0, 0.8), target_scale=0.1
        ),
        camera=CameraConfig().model_dump(mode="json"),
        cube_min=(-0.15, -0.15, 0.8),
        cube_max=(0.15, 0.15, 0.9),
        best_epoch=1,
    )
    (estimator / "estimator.json").write_text(card.model_dump_json(indent=2))
    save_file({"conv1.weight": torch.ones(8, 3, 7, 7)}, estimator / "estimator.safetensors")


def _write_policy(run: Path) -> None:
    """The policy of a finished run, as `collect --policy` reads it."""
    directory = run / "checkpoints"
    directory.mkdir()
    shapes = {"0.weight": (24, 8), "0.bias": (8,), "1.weight": (8, 7), "1.bias": (7,)}
    layers = {f"actor.{name}": torch.zeros(shape) for name, shape in shapes.items()}
    save_file(layers, directory / "policy.safetensors")
    described = {"hidden": [8], "proprioception": "forward_kinematics", "task": "reach", "summary": {}}
    (directory / "policy.json").write_text(json.dumps(described))
