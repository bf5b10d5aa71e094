"""Checkpoints of a run: its networks and where it stood. Each is a directory that is whole or absent."""

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors import torch as tensors_io
from torch import Tensor

from schemas.errors import ArtifactError
from schemas.files import fsync_directory, write_bytes
from schemas.integrity import file_ref, problem
from schemas.manifest import FileRef, canonical_sha256
from stages.policy.td3 import TD3

_DIGITS = 6 * "[0-9]"
DESCRIPTION = "checkpoints/policy.json"
KEPT = 2  # runs of a matrix may have been killed one checkpoint apart


@dataclass(frozen=True, order=True)
class Position:
    """How far a run is."""

    episodes: int  # training episodes finished
    final: int  # episodes of the final evaluation finished

    @property
    def name(self) -> str:
        return f"{self.episodes:06d}-{self.final:06d}"


@dataclass(frozen=True)
class Remembered:
    """What a checkpoint knows besides the networks."""

    episodes: int
    final: int
    counts: dict[str, int]  # of the log
    sha256: str  # of the networks and of all the others: a flipped bit would be another number
    run: str = ""  # NAME/CELL; older checkpoints do not say


def available(out: Path) -> list[Position]:
    """Positions of a run's checkpoints, oldest first."""
    names = [path.name.split("-") for path in out.glob(f"checkpoints/{_DIGITS}-{_DIGITS}")]
    return sorted(Position(int(episodes), int(final)) for episodes, final in names)


def save(out: Path, run: str, position: Position, td3: TD3, row: int, counts: dict[str, int]) -> None:
    """Write a checkpoint of the run NAME/CELL and drop all but the last few."""
    directory = out / "checkpoints" / position.name
    temporary = out / "checkpoints" / f".{position.name}.tmp"
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        temporary.mkdir(parents=True)
        tensors = {name: rows[row].contiguous().cpu() for name, rows in _tensors(td3).items()}
        data = tensors_io.save(tensors)
        seal = _seal(data, position, counts, run)
        remembered = Remembered(**asdict(position), counts=counts, sha256=seal, run=run)
        write_bytes(data, temporary / "td3.safetensors")
        write_bytes(json.dumps(asdict(remembered)).encode(), temporary / "state.json")
        shutil.rmtree(directory, ignore_errors=True)
        temporary.replace(directory)
    except BaseException:  # on a full disk half of it would take the room that the next try needs
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    fsync_directory(directory.parent)
    for old in available(out)[:-KEPT]:
        shutil.rmtree(out / "checkpoints" / old.name)


def drop_after(out: Path, position: Position) -> None:
    """Remove the checkpoints later than `position`, from which a run goes on."""
    for later in available(out):
        if later > position:
            shutil.rmtree(out / "checkpoints" / later.name)


def drop_all(out: Path) -> None:
    """Remove every checkpoint of a run that has ended."""
    for position in available(out):
        shutil.rmtree(out / "checkpoints" / position.name)


def load(out: Path, run: str, position: Position, td3: TD3, row: int) -> Remembered:
    """Put the networks of the run NAME/CELL back and return the rest.

    Raises:
        ArtifactError: the checkpoint is damaged, or of another run or other networks.
    """
    directory = out / "checkpoints" / position.name
    try:
        data, remembered = _unsealed(directory, run, position)
        saved = tensors_io.load(data)
        for name, rows in _tensors(td3).items():
            rows[row].copy_(saved[name])
        return remembered
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
        raise ArtifactError(f"checkpoint {directory} cannot be read ({error}); remove it to resume earlier") from error


def counts(out: Path, run: str, position: Position) -> dict[str, int] | None:
    """How much of the log a checkpoint counts on; None where it is damaged, or of another run."""
    try:
        return _unsealed(out / "checkpoints" / position.name, run, position)[1].counts
    except (OSError, ValueError, TypeError):
        return None


def _unsealed(directory: Path, run: str, position: Position) -> tuple[bytes, Remembered]:
    data = (directory / "td3.safetensors").read_bytes()
    remembered = Remembered(**json.loads((directory / "state.json").read_bytes()))
    if remembered.sha256 != _seal(data, position, remembered.counts, remembered.run):
        raise ValueError("it is not what was written")
    if remembered.run not in ("", run):
        raise ValueError(f"it is of {remembered.run}")
    return data, remembered


def publish(out: Path, td3: TD3, row: int, description: Mapping[str, object]) -> None:
    """Keep the finished run's networks under standard names, and drop the checkpoints.

    `description`, which holds the run's summary, is written last before they go: where it is, the run has ended. It
    says too what the files of the run are then, for no manifest does yet (see `damage`).
    """
    width = td3.critic_net.parameters
    networks = {
        "actor": td3.actor_net.named(td3.actor[row]),
        "critic1": td3.critic_net.named(td3.critic[row, :width]),
        "critic2": td3.critic_net.named(td3.critic[row, width:]),
    }
    tensors = {
        f"{net}.{name}": value.cpu()
        for net, named in networks.items()
        for name, value in td3.of_raw_observations(row, named).items()
    }
    directory = out / "checkpoints"
    directory.mkdir(exist_ok=True)
    write_bytes(tensors_io.save(tensors), directory / "policy.safetensors")
    files = [directory / "policy.safetensors", *sorted(out.rglob("*.parquet"))]
    told = {**description, "files": [file_ref(out, path).model_dump() for path in files]}
    write_bytes(json.dumps({**told, "sha256": canonical_sha256(told)}, indent=2).encode(), out / DESCRIPTION)
    drop_all(out)


def unpublish(out: Path) -> None:
    """The run is to go on, or begin anew: it has not ended."""
    (out / DESCRIPTION).unlink(missing_ok=True)


def published(out: Path) -> dict[str, Any] | None:
    """Summary of a run that ended, or None: it may have been killed before its manifest said so.

    Raises:
        ArtifactError: it ended, and is not what was written.
    """
    if not (out / DESCRIPTION).exists():
        return None
    if found := damage(out):
        raise ArtifactError(f"{out} had ended, but {', '.join(found.values())}: `pipeline repair` keeps what is whole")
    return dict(_told(out)["summary"])


def damage(out: Path) -> dict[str, str]:
    """Files of a run that has ended that are not what was written, and what is wrong with each."""
    if not (out / DESCRIPTION).exists():
        return {}
    try:
        told = _told(out)
        files = [FileRef.model_validate(file) for file in told["files"]]
        dict(told["summary"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {DESCRIPTION: f"{DESCRIPTION} is not what was written"}
    return {file.path: found for file in files if (found := problem(out, file)) is not None}


def _told(out: Path) -> dict[str, Any]:
    """What was published of a run; one of many errors where it is not what was written."""
    told: dict[str, Any] = json.loads((out / DESCRIPTION).read_bytes())
    if told.pop("sha256") != canonical_sha256(told):
        raise ValueError("it is not what was written")
    return told


def _seal(data: bytes, position: Position, counts: dict[str, int], run: str) -> str:
    told = [asdict(position), counts, *([run] if run else [])]
    return hashlib.sha256(data + json.dumps(told, sort_keys=True).encode()).hexdigest()


def _tensors(td3: TD3) -> dict[str, Tensor]:
    """Everything that learning changes, a row per run."""
    return {
        "actor": td3.actor,
        "critic": td3.critic,
        "actor_target": td3.actor_target,
        "critic_target": td3.critic_target,
        "actor_mean": td3.actor_optimiser.mean,
        "actor_square": td3.actor_optimiser.square,
        "actor_steps": td3.actor_optimiser.steps,
        "critic_mean": td3.critic_optimiser.mean,
        "critic_square": td3.critic_optimiser.square,
        "critic_steps": td3.critic_optimiser.steps,
        "updates": td3.updates,
    }
