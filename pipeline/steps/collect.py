"""collect → datasets/NAME."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import interrupts
from pipeline.artifacts.inputs import load
from pipeline.artifacts.space import require_space
from pipeline.artifacts.store import Build, Request
from pipeline.steps.session import Outcome, Session, make
from schemas.errors import ConfigError
from schemas.manifest import InputRef
from stages.collect.config import CollectStageConfig

if TYPE_CHECKING:
    from stages.collect.behaviours import ActorFactory

BYTES_PER_PIXEL = 3
BYTES_PER_STEP = 2_000
"""Poses, joints, states and actions of a step in MCAP, compressed."""


def stage_config(session: Session) -> CollectStageConfig:
    """The sections a dataset depends on."""
    config = session.config
    return CollectStageConfig(world=config.world, camera=config.camera, collect=config.collect)


def request(session: Session, name: str, policy: str | None = None) -> Request:
    """The dataset asked for; `policy` is the id of a run that acts instead of the scripted controllers."""
    inputs = [_policy_input(session, policy)] if policy else []
    config, defaults = (each.model_dump(mode="json") for each in (stage_config(session), CollectStageConfig()))
    return Request(f"datasets/{name}", config, inputs, defaults)


def _policy_input(session: Session, policy: str) -> InputRef:
    """Pin the run; ConfigError when it was trained for another task than those to collect."""
    pinned = session.pin(policy)
    task = load(session.root, policy).config["run"]["task"]
    if set(session.config.collect.tasks) != {task}:
        raise ConfigError(f"{policy} was trained to {task}: collect with it by --set collect.tasks=\"['{task}']\"")
    return pinned


def space_needed(config: CollectStageConfig) -> int:
    """Upper estimate [bytes] of a dataset."""
    steps = config.collect.episodes * config.collect.steps
    frames = steps * config.collect.keep_fraction
    return int(frames * config.camera.image_size**2 * BYTES_PER_PIXEL + steps * BYTES_PER_STEP)


def collect(session: Session, name: str, policy: str | None = None) -> Outcome:
    """Collect a dataset."""
    config = stage_config(session)

    def stage(build: Build) -> dict[str, Any]:
        from stages.collect.run import run

        if not build.resumed:
            require_space(session.root, space_needed(config))
        actor = _actor_factory(session.store.path(policy)) if policy else None
        with interrupts.finishing():
            return run(config, build.path, dataset=name, actor=actor, progress=session.progress)

    return make(session, request(session, name, policy), stage, renders=True)


def _actor_factory(run: Path) -> "ActorFactory":
    """Actors that follow a trained policy, made from its artifact on disk: collect never imports policy."""
    from stages.policy.actor import load_actor

    return partial(load_actor, run)
