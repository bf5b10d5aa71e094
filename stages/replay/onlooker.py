"""Logged episodes replayed for what the logs do not hold: the simulator's states, and frames of a camera."""

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np

from stages.replay.frames import Camera, run_camera
from stages.replay.logs import LoggedEpisode
from stages.replay.proof import compare
from stages.replay.simulate import Watch, scene_of, simulate
from stages.sim.renderer import Renderer
from stages.sim.world import World


class Seen(NamedTuple):
    """Of n steps, the initial state first."""

    states: np.ndarray  # (n + 1, k) float64, MuJoCo's integration states: time [s], qpos, qvel and what follows
    frames: np.ndarray  # (n + 1, H, W, 3) uint8


class Onlooker:
    """Watches episodes of one scene through the camera of their run, with one renderer until `stack` ends."""

    def __init__(self, stack: ExitStack, *, image_size: int | None = None, otherwise: Mapping[str, Any] = {}) -> None:
        """`image_size` [pixels] is by default the run's; `otherwise`: see `run_camera`."""
        self._stack, self._image_size, self._otherwise = stack, image_size, otherwise
        self._renderer: Renderer | None = None

    def watch(self, logged: LoggedEpisode) -> Seen:
        """Replay an episode before the camera.

        Raises:
            ArtifactError: the initial state is of another scene, or the replay is another trajectory.
            MachineError: there is no OpenGL to render with.
        """
        camera = run_camera(logged, otherwise=self._otherwise)
        renderer = self._of(logged, camera)
        frames: list[np.ndarray] = []
        states = replayed(logged, lambda world: frames.append(renderer.render(world.qpos_full(), camera.pose)))
        return Seen(states, np.stack(frames))

    def _of(self, logged: LoggedEpisode, camera: Camera) -> Renderer:
        if self._renderer is None:
            size = self._image_size or camera.config.image_size
            self._renderer = self._stack.enter_context(Renderer(scene_of(logged), size, camera.config.fovy))
        return self._renderer


def replayed(logged: LoggedEpisode, watch: Watch | None = None) -> np.ndarray:
    """Replay an episode and prove it identical; the integration states (n + 1, k), the initial one first.

    Raises:
        ArtifactError: the initial state is of another scene, or the replay is another trajectory.
    """
    states: list[np.ndarray] = []

    def look(world: World) -> None:
        states.append(world.integration_state())
        if watch:
            watch(world)

    compare(logged, simulate(logged, look)).require_identical()
    return np.stack(states)
