"""Training and test of the estimator (SPEC §4)."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor

from schemas.datasets import Rerender
from schemas.errors import ArtifactError, DivergedError
from schemas.files import write_parquet
from schemas.progress import Progress, Task
from schemas.tables import EPOCHS
from stages.device import arithmetic, torch_device
from stages.perception.checkpoint import (
    TrainingState,
    drop_checkpoints,
    restore_checkpoint,
    restore_ended,
    save_checkpoint,
)
from stages.perception.config import PerceptionConfig
from stages.perception.dataset import Frames, load_frames
from stages.perception.estimator import Estimator, EstimatorCard, save_estimator
from stages.perception.evaluation import evaluate
from stages.perception.metrics import ErrorSummary, summarise
from stages.perception.normalisation import Normalisation, measure
from stages.perception.quantised import Ranges, measure_ranges
from stages.perception.resnet34 import ResNet34, load_weights

_WARM_UP = 0.2
"""Share of the steps in which the learning rate rises."""
_INFERENCE_BATCH = 256
_RANGE_FRAMES = 256
"""Frames that the ranges of activations are taken from: more of the same scene hardly widen them."""


def run(
    config: PerceptionConfig,
    dataset: Path,
    out: Path,
    *,
    estimator: str,
    weights: Path | None,
    rerender: Rerender,
    progress: Progress,
) -> dict[str, Any]:
    """Train on the dataset in `dataset`, keep the weights of lowest validation error, test them; resumes from `out`.

    `weights`: ImageNet weights to start from. Returns the manifest's summary. Raises ArtifactError for a dataset or
    weights that cannot be used, MachineError without the configured device, DivergedError when training diverges.
    """
    device = torch_device(config.device)
    frames = load_frames(dataset, out, progress)
    trainer = Trainer(config, frames, device)
    state = trainer.start(estimator, weights)
    if not restore_ended(state, out, config.epochs):
        restore_checkpoint(state, out)
    trainer.fit(state, out, estimator, progress)
    ranges = trainer.ranges(state.best) if config.quantise else None
    save_estimator(out, _card(config, frames, trainer.normalisation, estimator, state.best_epoch, ranges), state.best)
    loaded = Estimator.load(out, config.device)  # tested as it will be used: from the artifact, folded, on this device
    started = time.monotonic()
    recorded, misaligned = evaluate(loaded, frames, config.test_misalignments, estimator, rerender, out, progress)
    state.rows.append(_row("test", config.epochs, recorded, 0.0, time.monotonic() - started))
    write_epochs(state.rows, estimator, out)
    drop_checkpoints(out)  # of no use once the estimator is there, and eight times its size
    return {
        "test_mean_error": recorded.mean_error,
        "test_median_error": recorded.median_error,
        "test_p95_error": recorded.p95_error,
        "epochs": config.epochs,
        "parameters": sum(parameter.numel() for parameter in state.network.parameters()),
        "misalignment": misaligned,
    }


def learning_rate(step: int, steps: int, peak: float) -> float:
    """One cycle: linear from peak / 25 to `peak`, then a half cosine to zero at `steps`."""
    warm = max(1.0, _WARM_UP * steps)
    if step < warm:
        return peak * (1 + 24 * step / warm) / 25
    return peak * 0.5 * (1 + math.cos(math.pi * (step - warm) / max(1.0, steps - warm)))


class Trainer:
    """The loop over epochs; what changes from epoch to epoch is in TrainingState."""

    def __init__(self, config: PerceptionConfig, frames: Frames, device: torch.device) -> None:
        self.config, self.frames, self.device = config, frames, device
        self.train, self.validation = frames.indices("train"), frames.indices("validation")
        if len(self.train) < 2:
            raise ArtifactError(
                f"dataset {frames.dataset}: training takes two frames at least, it has {len(self.train)}"
            )
        self.normalisation = measure(frames.images, frames.positions, self.train)
        self.targets = self.normalisation.targets(frames.positions)  # (n, 3)
        # Batches of nearly equal size, at least batch_size: a remainder of one frame has no batch statistics.
        self.steps_per_epoch = max(1, len(self.train) // config.batch_size)
        self.dtype = arithmetic(config.precision, device)

    def start(self, estimator: str, weights: Path | None) -> TrainingState:
        """The state of `estimator` before the first epoch: seeded weights, or those in the file `weights`."""
        with torch.random.fork_rng(devices=()):
            torch.default_generator.manual_seed(self.config.seed)
            network = ResNet34()
        if weights is not None:
            load_weights(network, weights)
        network.to(self.device)
        decayed = [parameter for parameter in network.parameters() if parameter.ndim > 1]
        others = [parameter for parameter in network.parameters() if parameter.ndim == 1]  # batch norms and the bias
        groups = [
            {"params": decayed, "weight_decay": self.config.weight_decay},
            {"params": others, "weight_decay": 0.0},
        ]
        optimizer = torch.optim.AdamW(groups, lr=self.config.learning_rate, fused=True)
        return TrainingState(estimator, network, optimizer)

    def fit(self, state: TrainingState, out: Path, estimator: str, progress: Progress) -> None:
        """Train until `config.epochs`, writing epochs.parquet and checkpoints into `out`."""
        epochs, frames = self.config.epochs, len(self.train)
        deterministic = torch.backends.cudnn.flags(benchmark=False, deterministic=True)
        with progress.task("train estimator", epochs * frames, done=state.epoch * frames) as task, deterministic:
            while state.epoch < epochs:
                validation = self._epoch(state, task)
                task.note(f"epoch {state.epoch}/{epochs}, validation {100 * validation.mean_error:.2f} cm")
                write_epochs(state.rows, estimator, out)
                stopping = progress.stopping()
                if stopping or state.epoch % self.config.checkpoint_epochs == 0 or state.epoch == epochs:
                    save_checkpoint(state, out)
                if stopping:
                    raise KeyboardInterrupt

    def ranges(self, weights: dict[str, Tensor]) -> Ranges:
        """Ranges of the activations over training frames evenly spaced."""
        with torch.device("meta"):
            network = ResNet34()
        network.load_state_dict(weights, assign=True)
        rows = self.train[np.linspace(0, len(self.train) - 1, min(_RANGE_FRAMES, len(self.train))).astype(int)]
        return measure_ranges(network.eval(), self.normalisation.images(torch.from_numpy(self.frames.images[rows])))

    def _epoch(self, state: TrainingState, task: Task) -> ErrorSummary:
        started = time.monotonic()
        train = self._train_epoch(state, task)
        trained = time.monotonic()
        validation = self._validate(state.network)
        self._check(validation.loss, f"validation loss is {validation.loss} after epoch {state.epoch + 1}")
        state.epoch += 1
        rate = state.optimizer.param_groups[0]["lr"]
        state.rows.append(_row("train", state.epoch, train, rate, trained - started))
        state.rows.append(_row("validation", state.epoch, validation, rate, time.monotonic() - trained))
        if validation.mean_error < state.best_error:
            state.best_error, state.best_epoch = validation.mean_error, state.epoch
            state.best = {key: value.cpu().clone() for key, value in state.network.state_dict().items()}
        return validation

    def _train_epoch(self, state: TrainingState, task: Task) -> ErrorSummary:
        """One pass in an order that depends on seed and epoch alone; errors as they were before each step."""
        rng = np.random.default_rng(np.random.SeedSequence([self.config.seed, state.epoch]))
        order = rng.permutation(self.train)
        outputs = []
        state.network.train()
        for number, batch in enumerate(np.array_split(order, self.steps_per_epoch)):
            step = state.epoch * self.steps_per_epoch + number
            outputs.append(self._step(state, step, batch))
            task.advance(len(batch))
        return self._summarise(order, torch.cat(outputs))

    def _step(self, state: TrainingState, step: int, batch: np.ndarray) -> Tensor:
        for group in state.optimizer.param_groups:
            group["lr"] = learning_rate(step, self.config.epochs * self.steps_per_epoch, self.config.learning_rate)
        output = self._forward(state.network, batch)  # (n, 3)
        target = torch.from_numpy(self.targets[batch]).to(self.device)
        # Equation 2 of the paper is minus this sum, the sign of a score; what is minimised is the positive sum.
        loss = (output - target).square().sum(dim=1).mean()
        self._check(loss.item(), f"loss is {loss.item()} in epoch {state.epoch + 1}, step {step}")
        state.optimizer.zero_grad()
        loss.backward()
        state.optimizer.step()
        return output.detach()

    def _check(self, value: float, found: str) -> None:
        if not math.isfinite(value):
            raise DivergedError(
                f"training diverged: the {found}; lower perception.learning_rate "
                f"(now {self.config.learning_rate:g}) or set perception.precision to float32"
            )

    def _forward(self, network: ResNet34, batch: np.ndarray) -> Tensor:
        images = torch.from_numpy(self.frames.images[batch]).to(self.device)
        with torch.autocast(self.device.type, self.dtype, enabled=self.dtype != torch.float32):
            return network(self.normalisation.images(images)).float()

    @torch.inference_mode()
    def _validate(self, network: ResNet34) -> ErrorSummary:
        network.eval()
        batches = np.array_split(self.validation, math.ceil(len(self.validation) / _INFERENCE_BATCH))
        return self._summarise(self.validation, torch.cat([self._forward(network, batch) for batch in batches]))

    def _summarise(self, rows: np.ndarray, outputs: Tensor) -> ErrorSummary:
        return summarise(self.frames.positions[rows], self.normalisation.positions(outputs))


def write_epochs(rows: list[dict[str, Any]], estimator: str, out: Path) -> None:
    """epochs.parquet of all epochs so far, replaced as a whole."""
    table = pa.Table.from_pylist([{"estimator": estimator, **row} for row in rows], schema=EPOCHS)
    write_parquet(table, out / "epochs.parquet")


def _row(split: str, epoch: int, errors: ErrorSummary, rate: float, seconds: float) -> dict[str, Any]:
    fields = vars(errors) | {f"bias_{axis}": float(value) for axis, value in zip("xyz", errors.bias, strict=True)}
    del fields["bias"]
    return {"split": split, "epoch": epoch, **fields, "learning_rate": rate, "seconds": seconds}


def _card(
    config: PerceptionConfig,
    frames: Frames,
    normalisation: Normalisation,
    estimator: str,
    best_epoch: int,
    ranges: Ranges | None,
) -> EstimatorCard:
    positions = frames.positions[frames.indices("train")]
    return EstimatorCard(
        estimator=estimator,
        dataset=frames.dataset,
        image_size=frames.image_size,
        precision=config.precision,
        normalisation=normalisation,
        camera=frames.camera,
        cube_min=tuple(positions.min(axis=0).tolist()),
        cube_max=tuple(positions.max(axis=0).tolist()),
        best_epoch=best_epoch,
        ranges=ranges,
    )
