"""Exact re-simulation of a logged episode: initial state and actions in, the same trajectory out (SPEC §1)."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from schemas.errors import ArtifactError
from stages.replay.logs import LoggedEpisode
from stages.sim.config import WorldConfig
from stages.sim.scene import Scene, build_scene
from stages.sim.world import World

Watch = Callable[[World], None]
"""Called with the world in its initial state and after every step: n + 1 times."""


@dataclass(frozen=True)
class Trajectory:
    """A re-simulated episode; row k of the states is the one after action k, as in the logs."""

    initial: np.void  # record of STATE_DTYPE
    states: np.ndarray  # (n,) records of STATE_DTYPE
    final_state: np.ndarray  # (k,) float64, MuJoCo integration state
    seconds: float  # of simulation: without building the scene, without watching


def scene_of(logged: LoggedEpisode) -> Scene:
    """The scene the run was made in.

    Raises:
        ArtifactError: the manifest's world is not one this version knows.
    """
    try:
        config = WorldConfig.model_validate(logged.manifest.config["world"])
    except (KeyError, ValidationError) as error:
        raise ArtifactError(f"{logged.run_dir}/manifest.json describes no known world: {error}") from error
    return build_scene(config)


def simulate(logged: LoggedEpisode, watch: Watch | None = None, *, compiled: bool = True) -> Trajectory:
    """Step the episode's world from its initial state with its logged actions.

    Not `compiled`, an episode takes twice as long, but nothing is loaded for most of a second before: see `World`.

    Raises:
        ArtifactError: the initial state is of another scene.
    """
    world = World(scene_of(logged), logged.task, compiled=compiled)
    initial = world.reset(logged.initial_state)
    watch = watch or (lambda _: None)
    watch(world)
    states, seconds = [], 0.0
    for action in logged.rows["action"]:
        start = time.perf_counter()
        states.append(world.step(action))
        seconds += time.perf_counter() - start
        watch(world)
    return Trajectory(initial, np.array(states), world.integration_state(), seconds)
