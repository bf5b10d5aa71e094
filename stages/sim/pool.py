"""Many worlds stepped as one, in this process or in worker processes that hand frames over in shared memory."""

import multiprocessing
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np

from schemas.errors import MachineError
from stages.sim.camera import CameraPose
from stages.sim.config import WorldConfig, action_dim
from stages.sim.processes import interrupts_ignored, portable
from stages.sim.shared import Arrays, Shared, allocate


@dataclass(frozen=True)
class View:
    """Where each world's camera stands, and its optics."""

    poses: tuple[CameraPose, ...]  # one per world
    image_size: int
    fovy: float  # [degrees]


class Worlds(Protocol):
    """What the training loop needs of a batch of n worlds. Arrays are views that the next call overwrites."""

    states: np.ndarray  # (n,) of STATE_DTYPE
    frames: np.ndarray | None  # (n, H, W, 3) uint8
    action_dim: int

    def reset(self, entropies: Sequence[Sequence[int]]) -> None:
        """Start an episode in each world, drawn from a random stream seeded by its entropy."""

    def start_step(self, actions: np.ndarray) -> None:
        """Begin one step under actions (n, action_dim) float32; returns at once where workers do it."""

    def finish_step(self) -> None:
        """Wait until `states` and `frames` are those after the step."""

    def packed_states(self) -> list[np.ndarray]:
        """Each world's integration state, for exact replay."""

    def drop(self, index: int) -> None:
        """Step this world no more."""

    def close(self) -> None:
        """End the workers and free what they hold."""


class _Group:
    """Worlds of one process, with one renderer."""

    def __init__(self, config: WorldConfig, task: str, view: View | None, arrays: Arrays) -> None:
        from stages.sim.renderer import Renderer  # here: a parent whose workers simulate needs no OpenGL
        from stages.sim.scene import build_scene
        from stages.sim.world import World

        self._task, self._view, self._arrays = task, view, arrays
        self._scene = build_scene(config)
        self._worlds = [World(self._scene, task) for _ in arrays.states]
        self._renderer = Renderer(self._scene, view.image_size, view.fovy) if view else None

    def reset(self, entropies: Sequence[Sequence[int]]) -> None:
        from stages.sim.tasks import sample_initial_state

        for index, (world, entropy) in enumerate(zip(self._worlds, entropies, strict=True)):
            rng = np.random.default_rng(np.random.SeedSequence(entropy))
            self._store(index, world.reset(sample_initial_state(self._scene, self._task, rng)))

    def step(self) -> None:
        for index, world in enumerate(self._worlds):
            if self._arrays.active[index]:
                self._store(index, world.step(self._arrays.actions[index]))

    def packed_states(self) -> list[np.ndarray]:
        return [world.integration_state() for world in self._worlds]

    def close(self) -> None:
        if self._renderer:
            self._renderer.close()

    def _store(self, index: int, state: np.void) -> None:
        self._arrays.states[index] = state
        if self._renderer and self._view and self._arrays.frames is not None:
            qpos = self._worlds[index].qpos_full()
            self._arrays.frames[index] = self._renderer.render(qpos, self._view.poses[index])


class WorldPool:
    """`Worlds` of one task; `workers` = 0 simulates in this process.

    Raises:
        MachineError: no OpenGL, or a worker died.
    """

    def __init__(self, config: WorldConfig, task: str, worlds: int, view: View | None, workers: int) -> None:
        self.action_dim = action_dim(task)
        self._arrays, shared = allocate(worlds, view.image_size if view else None, self.action_dim)
        self.states, self.frames = self._arrays.states, self._arrays.frames
        self._arrays.active[:] = True
        shares = [share for share in np.array_split(np.arange(worlds), max(1, workers)) if len(share)]
        self._slices = [slice(int(share[0]), int(share[-1]) + 1) for share in shares]
        self._hands: list[_Local | _Remote] = []
        try:
            for rows in self._slices:
                part = View(view.poses[rows], view.image_size, view.fovy) if view else None
                if workers:
                    self._hands.append(_Remote(config, task, part, shared, rows))
                else:
                    self._hands.append(_Local(_Group(config, task, part, self._arrays.rows(rows))))
            self._all("ready")
        except BaseException:
            self.close()
            raise

    def reset(self, entropies: Sequence[Sequence[int]]) -> None:
        for hand, rows in zip(self._hands, self._slices, strict=True):
            hand.send("reset", entropies[rows])
        self.finish_step()

    def start_step(self, actions: np.ndarray) -> None:
        self._arrays.actions[:] = actions
        for hand in self._hands:
            hand.send("step")

    def finish_step(self) -> None:
        for hand in self._hands:
            hand.receive()

    def packed_states(self) -> list[np.ndarray]:
        return [state for states in self._all("packed_states") for state in states]

    def drop(self, index: int) -> None:
        self._arrays.active[index] = False

    def close(self) -> None:
        for hand in self._hands:
            hand.close()

    def _all(self, method: str) -> list[Any]:
        for hand in self._hands:
            hand.send(method)
        return [hand.receive() for hand in self._hands]


class _Local:
    """A group in this process: `send` does the work, `receive` returns its result."""

    def __init__(self, group: _Group) -> None:
        self._group, self._result = group, None

    def send(self, method: str, *arguments: Any) -> None:
        self._result = None if method == "ready" else getattr(self._group, method)(*arguments)

    def receive(self) -> Any:
        return self._result

    def close(self) -> None:
        self._group.close()


class _Remote:
    """A group in a worker process, asked through a pipe."""

    def __init__(self, config: WorldConfig, task: str, view: View | None, shared: Shared, rows: slice) -> None:
        context = multiprocessing.get_context("spawn")  # a forked OpenGL or torch state is undefined
        self._pipe, theirs = context.Pipe()
        arguments = (theirs, config, task, view, shared, rows)
        self._process = context.Process(target=_serve, args=arguments, daemon=True, name=f"worlds-{rows.start}")
        with interrupts_ignored(signal.SIGTERM):  # a supervisor sends it to all; the worker ends with its pipe
            self._process.start()
        theirs.close()

    def send(self, method: str, *arguments: Any) -> None:
        try:
            self._pipe.send((method, arguments))
        except OSError as error:
            raise self._died() from error

    def receive(self) -> Any:
        try:
            failure, result = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise self._died() from error
        if failure is not None:
            raise failure
        return result

    def close(self) -> None:
        self._pipe.close()  # the worker ends at the end of its pipe
        self._process.join(timeout=5)
        if self._process.is_alive():
            self._process.kill()

    def _died(self) -> MachineError:
        self._process.join(timeout=1)
        code = self._process.exitcode
        return MachineError(
            f"a simulation worker died (exit code {code}); the log up to the last checkpoint is on disk: use --resume"
        )


def _serve(pipe: Connection, config: WorldConfig, task: str, view: View | None, shared: Shared, rows: slice) -> None:
    try:
        group = _Group(config, task, view, shared.arrays().rows(rows))
    except Exception as error:
        pipe.send((portable(error), None))  # the answer to the first question, whatever it is
        return
    while True:
        try:
            method, arguments = pipe.recv()
            pipe.send(_answer(group, method, arguments))
        except (EOFError, OSError):  # the parent closed the pipe, or is gone
            group.close()
            return


def _answer(group: _Group, method: str, arguments: tuple[Any, ...]) -> tuple[Exception | None, Any]:
    """(failure, result), of which one is None."""
    try:
        return None, None if method == "ready" else getattr(group, method)(*arguments)
    except Exception as error:
        return portable(error), None
