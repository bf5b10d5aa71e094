"""Train a list of runs: those that can step in lockstep together, in as many processes as there are cores."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from schemas.errors import ConfigError, MachineError
from schemas.progress import Progress
from stages.policy import checkpoint
from stages.policy.checkpoint import Position
from stages.policy.config import RunConfig, RunResult, RunSpec
from stages.policy.group import START, train_group
from stages.policy.resources import Resources
from stages.policy.side_by_side import train_side_by_side


def run(
    specs: Sequence[RunSpec],
    estimator: Path | None,
    *,
    resources: Resources,
    finished: Callable[[RunResult], None],
    progress: Progress,
) -> None:
    """Train every run, those of one task and configuration together, from their last checkpoints.

    Each run's result goes to `finished` as soon as its group has ended: an interruption later does not touch it.

    Raises:
        ArtifactError: a run that ended before its manifest said so is not what was written.
        ConfigError: a scheme needs an estimator and there is none.
        MachineError: no GPU where one was asked for, no OpenGL, or a worker died.
    """
    if estimator is None and not all(spec.acts_on_truth for spec in specs):
        raise ConfigError("only an oracle that sees the truth needs no estimator: name one with --estimator")
    if resources.device == "cuda" and not torch.cuda.is_available():
        raise MachineError("device = cuda, but torch finds no GPU; set policy.device=cpu")
    missing = []
    for spec in specs:
        summary = checkpoint.published(spec.out)
        if summary is None:
            missing.append(spec)
        else:
            checkpoint.drop_all(spec.out)  # killed while it did so itself
            finished(RunResult(spec.run_id, "complete", summary))
    for group in groups(missing):
        for result in _train(group, estimator, resources, progress):
            finished(result)


def _train(
    group: list[RunSpec], estimator: Path | None, resources: Resources, progress: Progress
) -> Iterator[RunResult]:
    share = resources.share(len(group))
    if share.processes == 1:
        yield from train_group(group, estimator, share, progress)
    else:
        parts = [part.tolist() for part in np.array_split(np.array(group, dtype=object), share.processes)]
        yield from train_side_by_side(parts, estimator, share, progress)


def groups(specs: Sequence[RunSpec]) -> list[list[RunSpec]]:
    """Split into lists that step in lockstep: same task, world, resume point, and configuration but for the switch."""
    alike: dict[Any, list[RunSpec]] = {}
    for spec in specs:
        own = spec.task, spec.world, _but_for_the_switch(spec.config), bool(spec.sources)
        alike.setdefault(own, []).append(spec)
    return [part for group in alike.values() for part in _by_resume_point(group)]


def _but_for_the_switch(config: RunConfig) -> RunConfig:
    """What runs in lockstep share: when and how the reward switches is each run's own."""
    return config.model_copy(update={"switch_episode": 0, "buffer": "keep", "reset": "none", "reset_updates": 0})


def _by_resume_point(group: list[RunSpec]) -> list[list[RunSpec]]:
    """One list where all runs have a checkpoint in common (or none has any), else a list per newest checkpoint."""
    points = [set(checkpoint.available(spec.out)) for spec in group]
    if not any(points) or set.intersection(*points):
        return [group]
    parts: dict[Position, list[RunSpec]] = {}
    for spec, own in zip(group, points, strict=True):
        parts.setdefault(max(own, default=START), []).append(spec)
    return list(parts.values())
