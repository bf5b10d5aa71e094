"""Training that can be interrupted: its whole state in one file, written atomically. Nothing is pickled."""

import hashlib
import json
import logging
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from schemas.errors import ArtifactError
from schemas.files import read_parquet, write_bytes
from stages.perception.estimator import saved_weights
from stages.perception.resnet34 import ResNet34

DIRECTORY = "checkpoints"
_KEEP = 2  # the newest, and the one before in case the newest is damaged

log = logging.getLogger(__name__)


@dataclass
class TrainingState:
    """Everything the next epoch depends on; the rest (batch order, learning rate) is computed from seed and epoch."""

    estimator: str  # NAME, without which a checkpoint of another one would fit
    network: ResNet34
    optimizer: torch.optim.Optimizer
    epoch: int = 0  # finished
    best: dict[str, Tensor] = field(default_factory=dict)  # weights of the lowest validation error
    best_error: float = float("inf")  # [m]
    best_epoch: int = 0
    rows: list[dict[str, Any]] = field(default_factory=list)  # of epochs.parquet


def save_checkpoint(state: TrainingState, out: Path) -> None:
    """Write the state after `state.epoch` epochs and drop all but the newest checkpoints."""
    directory = out / DIRECTORY
    directory.mkdir(exist_ok=True)
    scalars = {name: getattr(state, name) for name in ("epoch", "best_error", "best_epoch", "rows")}
    tensors = {key: value.detach().cpu().contiguous() for key, value in _tensors(state).items()}
    data = save(tensors, metadata={"scalars": json.dumps(scalars), "estimator": state.estimator})
    write_bytes(data, directory / f"epoch-{state.epoch:06d}-{_seal(data)}.safetensors")
    for old in _checkpoints(out)[_KEEP:]:
        old.unlink()


def drop_checkpoints(out: Path) -> None:
    """Remove all, the newest last: until it goes, training would go on from there."""
    for file in reversed(_checkpoints(out)):
        file.unlink()
    shutil.rmtree(out / DIRECTORY, ignore_errors=True)


def restore_ended(state: TrainingState, out: Path, epochs: int) -> bool:
    """Fill `state` from the estimator in `out` and its table of `epochs`, where both are whole: its checkpoints may be
    gone, for the manifest that ends a training is written after them. Only what is left to do is in it.
    """
    saved = saved_weights(out)
    try:
        table = read_parquet(out / "epochs.parquet")
        if set(table["estimator"].to_pylist()) != {state.estimator}:
            return False
    except (ArtifactError, KeyError):
        return False
    rows = [row for row in table.drop_columns(["estimator"]).to_pylist() if row["split"] != "test"]
    if saved is None or len(rows) != 2 * epochs:
        return False
    card, weights = saved
    best = min((row for row in rows if row["split"] == "validation"), key=lambda row: row["mean_error"])
    if best["epoch"] != card.best_epoch:
        return False
    state.epoch, state.rows = epochs, rows
    state.best, state.best_error, state.best_epoch = weights, best["mean_error"], card.best_epoch
    return True


def restore_checkpoint(state: TrainingState, out: Path) -> bool:
    """Fill `state` from the newest readable checkpoint in `out`; False when there is none and training starts anew."""
    for file in _checkpoints(out):
        try:
            if not file.stem.endswith(_seal(file.read_bytes())):
                raise ValueError
            with safe_open(file, "pt") as stored:
                told = stored.metadata()
                scalars, made_for = json.loads(told["scalars"]), told.get("estimator", state.estimator)
                tensors = {key: stored.get_tensor(key) for key in stored.keys()}  # noqa: SIM118 (not iterable itself)
            if made_for != state.estimator:
                raise ValueError
        except (SafetensorError, OSError, ValueError, KeyError, TypeError):
            log.warning("%s is damaged, or another's: going back to the checkpoint before it, or to the start", file)
            continue
        _fill(state, scalars, tensors)
        return True
    return False


def _seal(data: bytes) -> str:
    """Part of a checkpoint's name: a flipped bit of its numbers would be another number."""
    return hashlib.sha256(data).hexdigest()[:16]


def _checkpoints(out: Path) -> list[Path]:
    return sorted((out / DIRECTORY).glob("epoch-*.safetensors"), reverse=True)


def _tensors(state: TrainingState) -> dict[str, Tensor]:
    tensors = {f"network/{key}": value for key, value in state.network.state_dict().items()}
    tensors |= {f"best/{key}": value for key, value in state.best.items()}
    for parameter, moments in state.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{parameter}/{name}": value for name, value in moments.items()}
    return tensors


def _fill(state: TrainingState, scalars: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    moments: dict[int, dict[str, Tensor]] = {}
    network: dict[str, Tensor] = {}
    for key, value in tensors.items():
        kind, _, name = key.partition("/")
        if kind == "optimizer":
            parameter, _, moment = name.partition("/")
            moments.setdefault(int(parameter), {})[moment] = value
        else:
            (network if kind == "network" else state.best)[name] = value
    state.network.load_state_dict(network)
    groups = state.optimizer.state_dict()["param_groups"]
    state.optimizer.load_state_dict({"state": moments, "param_groups": groups})
    for name, value in scalars.items():
        setattr(state, name, value)
