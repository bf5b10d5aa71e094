"""Logged episodes as another scheme's policy, or one with another estimator, would have seen them."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from stages.replay.logs import LoggedEpisode
from stages.replay.onlooker import Onlooker
from stages.replay.reestimate import Eye, reestimate
from stages.replay.simulate import scene_of
from stages.sim.world import World

ReplaceCube = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(observations (n, o), cube positions (n, 3) [m]) → the same observations of those cubes; the policy room's."""


class Observer:
    """Sees episodes again as the new scheme's policy would have seen them."""

    def __init__(self, on_truth: bool, eye: Eye | None, replace_cube: ReplaceCube, stack: ExitStack) -> None:
        self._on_truth, self._eye, self._replace_cube = on_truth, eye, replace_cube
        self._onlooker = Onlooker(stack, image_size=eye.image_size, otherwise=eye.camera) if eye else None

    def again(self, logged: LoggedEpisode) -> LoggedEpisode:
        """With other estimates and observations where the scheme or the estimator asks for them.

        Raises:
            ArtifactError: its replay is another trajectory.
            MachineError: there is no OpenGL to render with.
        """
        cubes = None
        if self._eye and self._onlooker:
            cubes = self._eye.predict(self._onlooker.watch(logged).frames)  # (n + 1, 3)
            logged = reestimate(logged, cubes[1:], self._eye.name)
        if self._on_truth:
            first = World(scene_of(logged), logged.task, compiled=False).reset(logged.initial_state)["cube_position"]
            cubes = np.concatenate([first[None], logged.vector("cube_true")])
        return logged if cubes is None else self._seeing(logged, cubes)

    def _seeing(self, logged: LoggedEpisode, cubes: np.ndarray) -> LoggedEpisode:
        """Observations of `cubes` (n + 1, 3) before and after each action."""
        seen = {"observation": cubes[:-1], "next_observation": cubes[1:]}
        changed = {name: self._replace_cube(logged.rows[name], of) for name, of in seen.items()}
        return replace(logged, rows=logged.rows | changed)
