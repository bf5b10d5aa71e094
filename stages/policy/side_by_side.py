"""Parts of a group trained side by side, each in a process of its own."""

import multiprocessing
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from schemas.errors import MachineError
from schemas.files import remove_halves
from schemas.progress import Progress, Task
from stages.memory import prepare_memory_of_processes
from stages.policy.config import RunResult, RunSpec
from stages.policy.group import train_group
from stages.policy.resources import Share
from stages.sim.processes import end_with_parent, interrupts_ignored, portable, stay_on_own_cores

_STOPS_WITHIN = 0.5  # [s] after it was asked for: as often the parts are told


def train_side_by_side(
    parts: Sequence[list[RunSpec]], estimator: Path | None, share: Share, progress: Progress
) -> Iterator[RunResult]:
    """Results of all runs, part by part as they end.

    Raises:
        Exception: what a part could not do; the others first end their episode and write a checkpoint.
    """
    prepare_memory_of_processes()
    children: list[_Child] = []
    try:
        for index, part in enumerate(parts):
            children.append(_Child(index, part, estimator, share))
        begun = [child.receive() for child in children]
        ended = [content for kind, content in begun if kind == "ended"]
        counts = [content for kind, content in begun if kind == "begin"]
        busy = [child for child, (kind, _) in zip(children, begun, strict=True) if kind == "begin"]
        total, done = (sum(each[index] for each in counts) for index in (0, 1))
        label = f"{parts[0][0].task}, {sum(len(part) for part in parts)} runs"
        with progress.task(label, total, done) as task:
            yield from _results(busy, ended, task, progress)
    finally:
        with interrupts_ignored():
            for child in children:
                child.close()
        for spec in (spec for part in parts for spec in part):
            remove_halves(spec.out)  # of the parts that were ended in the middle of it


def _results(
    children: list["_Child"], ended: list[BaseException], task: Task, progress: Progress
) -> Iterator[RunResult]:
    """When all parts have ended it raises the first error, or KeyboardInterrupt where one of them was to stop.

    `ended` is by what some ended before they began.
    """
    busy = {child.pipe: child for child in children}
    while busy:
        if ended or progress.stopping():
            for child in busy.values():
                child.stop()
        for pipe in wait(list(busy), timeout=_STOPS_WITHIN):
            child = busy[pipe]  # type: ignore[index]  # `wait` gives back what it was given
            kind, content = child.receive()
            if kind == "advance":
                child.note_episodes(content)
                task.advance(content)
                task.note(f"{sum(child.rate for child in busy.values()):.0f} env steps/s")
                continue
            del busy[child.pipe]
            if kind == "results":
                yield from content
            else:
                ended.append(content)
    if ended:
        raise next((each for each in ended if isinstance(each, Exception)), KeyboardInterrupt())


class _Child:
    """A part in its process, and what it says."""

    def __init__(self, index: int, part: list[RunSpec], estimator: Path | None, share: Share) -> None:
        context = multiprocessing.get_context("spawn")  # a forked OpenGL or torch state is undefined
        self.pipe, theirs = context.Pipe(duplex=False)
        self.rate = 0.0  # environment steps/s of the last episode
        self._steps = len(part) * part[0].world.horizon
        self._since = time.monotonic()
        self._stop = context.Event()
        arguments = (theirs, self._stop, index, part, estimator, share)
        self._process = context.Process(target=_serve, args=arguments, name=f"train-{part[0].run_id}")
        with interrupts_ignored(signal.SIGTERM):  # a supervisor sends it to all; this process is told, or killed
            self._process.start()
        theirs.close()

    def receive(self) -> tuple[str, Any]:
        """The next message: `begin` and episodes in all and done; `advance` and how many; or the last: `results`, or
        `ended` and what ended it."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            return "ended", self._died()

    def stop(self) -> None:
        """Have the part end at its next whole episode."""
        self._stop.set()

    def note_episodes(self, count: int) -> None:
        """Keep the rate of episodes that were just finished."""
        now = time.monotonic()
        self.rate, self._since = count * self._steps / (now - self._since), now

    def close(self) -> None:
        """End the process, which has sent its results or is to be resumed from its checkpoints."""
        self.pipe.close()
        self._process.kill()
        self._process.join()

    def _died(self) -> MachineError:
        self._process.join(timeout=1)
        code = self._process.exitcode
        return MachineError(
            f"a training process died (exit code {code}); the log up to the last checkpoint is on disk: use --resume"
        )


def _serve(
    pipe: Connection, stop: Event, index: int, part: list[RunSpec], estimator: Path | None, share: Share
) -> None:
    threading.Thread(target=end_with_parent, daemon=True).start()
    stay_on_own_cores(index, share.processes)
    try:
        pipe.send(("results", train_group(part, estimator, share, _Reported(pipe, stop))))
    except KeyboardInterrupt as stopped:
        pipe.send(("ended", stopped))
    except Exception as error:
        pipe.send(("ended", portable(error)))


class _Reported:
    """Progress of a part, sent to the parent: `begin` once, then `advance`."""

    def __init__(self, pipe: Connection, stop: Event) -> None:
        self._pipe, self._stop = pipe, stop

    def stopping(self) -> bool:
        return self._stop.is_set()

    @contextmanager
    def task(self, label: str, total: int, done: int = 0) -> Iterator["_Reported"]:
        del label
        self._pipe.send(("begin", (total, done)))
        yield self

    def advance(self, units: int = 1) -> None:
        self._pipe.send(("advance", units))

    def note(self, text: str) -> None:
        del text  # the parent adds up the rates of all parts
