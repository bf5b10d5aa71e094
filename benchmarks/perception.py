"""Training of the estimator: its data path against one batch held in memory, and its error on stock's frames."""

import math
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
import torch

from benchmarks.measure import Rate, rate_of, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.render import StockCamera
from pipeline.artifacts.manifests import list_files, write_manifest
from schemas.datasets import FrameRef
from schemas.manifest import Code, Environment, Manifest, config_sha256
from schemas.progress import Silent
from stages.collect import run as collect
from stages.collect.config import CollectConfig, CollectStageConfig
from stages.collect.rerender import _states, make_rerender
from stages.perception import training
from stages.perception.checkpoint import TrainingState
from stages.perception.config import PerceptionConfig
from stages.perception.dataset import load_frames
from stages.perception.estimator import Estimator
from stages.perception.metrics import summarise
from stages.perception.training import Trainer
from stages.sim.camera import nominal_pose
from stages.sim.config import WorldConfig

DATASET = "bench"
_WORLD = WorldConfig(cube_half_range=0.1)  # of the demo: few frames suffice to learn it


def run(quick: bool) -> Outcome:
    """Collect, measure both rates in turns, train, and test on the same states rendered by both renderers."""
    episodes, epochs, rounds = (20, 1, 1) if quick else (640, 4, 3)
    stage = CollectStageConfig(
        world=_WORLD, collect=CollectConfig(episodes=episodes, steps=4 if quick else 20, keep_fraction=0.25)
    )
    config = PerceptionConfig(epochs=epochs, batch_size=8 if quick else 32, test_misalignments=())
    with tempfile.TemporaryDirectory() as directory:
        dataset, out = Path(directory) / DATASET, Path(directory) / "estimator"
        out.mkdir()
        _collect(stage, dataset)
        started = time.perf_counter()
        frames = load_frames(dataset, out, Silent())
        loading = time.perf_counter() - started
        trainer = Trainer(config, frames, torch.device("cpu"))
        images = len(trainer.train)
        rates = side_by_side(_contenders(trainer, config, 16 if quick else 320), rounds)
        path_ratio = ratio(rates, "real training", "one batch in memory")
        epoch = images / median(rates["real training"])
        trained = time.perf_counter()
        training.run(
            config, dataset, out, estimator="bench", weights=None, rerender=make_rerender(dataset), progress=Silent()
        )
        trained = time.perf_counter() - trained
        rows = frames.indices("test")
        errors = _errors(stage, dataset, out, [frames.refs[row] for row in rows], frames.positions[rows])
    step_ms = 1e3 / median(rates["real training"])
    return Outcome(
        benchmark="perception",
        compares=f"training on {images} frames on disk, decoding included, against one batch held in memory; "
        f"the estimator on {len(rows)} held-out states drawn by us and by robosuite",
        unit="image",
        targets=[
            Target(
                "real training / one batch in memory", path_ratio * epochs * epoch / (epochs * epoch + loading), 0.95
            ),
            Target(
                "error on stock frames / on fast frames", errors["stock"] / errors["fast"], 1.1, "×", at_least=False
            ),
        ],
        figures={
            "real training / one batch in memory, without decoding": path_ratio,
            "decoding, images/s": len(frames.refs) / loading,
            "error on fast frames, cm": 100 * errors["fast"],
            "error on stock frames, cm": 100 * errors["stock"],
            "error on fast frames in bfloat16 instead of 8-bit integers, cm": 100 * errors["bfloat16"],
            "training and test in all, s": trained,
            "fraction of the limit": path_ratio,
        },
        parts=[
            Part("network, loss, optimiser", step_ms, 1e3 / median(rates["one batch in memory"])),
            Part("decoding, spread over the epochs", 1e3 * loading / (epochs * images)),
        ],
        rounds=rates,
    )


def _collect(stage: CollectStageConfig, dataset: Path) -> None:
    """A dataset with its manifest, as `pipeline collect` leaves it."""
    dataset.mkdir()
    summary = collect.run(stage, dataset, dataset=DATASET, progress=Silent())
    config = stage.model_dump(mode="json")
    manifest = Manifest(
        id=f"datasets/{DATASET}",
        stage="collect",
        name=DATASET,
        status="complete",
        created_at="2026-01-02T03:04:05+00:00",
        config=config,
        config_sha256=config_sha256(config),
        inputs=[],
        code=Code(version="0", git_commit=None, dirty=None),
        environment=Environment(python="", platform="", cpu="", gpu=None, gl_renderer=None, packages={}),
        files=list_files(dataset),
        summary=summary,
    )
    write_manifest(manifest, dataset)


def _contenders(trainer: Trainer, config: PerceptionConfig, images: int) -> dict[str, Rate]:
    """Real training steps over shuffled frames, and the same steps on one batch that is ready."""
    batch, steps = config.batch_size, math.ceil(images / config.batch_size)
    real, fixed = trainer.start("bench", None), trainer.start("bench", None)
    pixels = trainer.normalisation.images(torch.from_numpy(trainer.frames.images[trainer.train[:batch]]))
    target = torch.from_numpy(trainer.targets[trainer.train[:batch]])
    rng = np.random.default_rng(0)

    def train() -> None:
        real.network.train()
        for step, rows in enumerate(np.array_split(rng.permutation(trainer.train)[: steps * batch], steps)):
            trainer._step(real, step, rows)

    def hold() -> None:
        fixed.network.train()
        for _ in range(steps):
            _step(trainer, fixed, pixels, target)

    count = min(steps * batch, len(trainer.train))
    return {"real training": rate_of(train, count), "one batch in memory": rate_of(hold, steps * batch)}


def _step(trainer: Trainer, state: TrainingState, pixels: torch.Tensor, target: torch.Tensor) -> None:
    """A training step and nothing else."""
    with torch.autocast("cpu", trainer.dtype, enabled=trainer.dtype != torch.float32):
        output = state.network(pixels).float()
    loss = (output - target).square().sum(dim=1).mean()
    state.optimizer.zero_grad()
    loss.backward()
    state.optimizer.step()


def _errors(
    stage: CollectStageConfig, dataset: Path, artifact: Path, refs: list[FrameRef], true: np.ndarray
) -> dict[str, float]:
    """Mean error [m] on the same states from the nominal camera, drawn by our renderer and by robosuite's."""
    fast = np.stack(list(make_rerender(dataset)(refs, "pan", 0.0)))
    stock, pose, size = StockCamera(stage.world, stage.camera.fovy), nominal_pose(stage.camera), stage.camera.image_size
    drawn = np.stack([stock.render(qpos, pose, size) for qpos in _states(dataset, refs)])
    stock.close()
    estimator, rounded = Estimator.load(artifact), Estimator.load(artifact, precision="bfloat16")
    found = {"fast": estimator.predict(fast), "stock": estimator.predict(drawn), "bfloat16": rounded.predict(fast)}
    return {name: summarise(true, estimates).mean_error for name, estimates in found.items()}
