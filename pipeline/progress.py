"""Progress bars on stderr, with rate and time left."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from pipeline import interrupts
from schemas import progress as contract


class _RateColumn(ProgressColumn):
    """Units per second, or seconds per unit where they are slow."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        if not speed:
            return Text("–/s", style="progress.data.speed")
        return Text(f"{speed:.1f}/s" if speed >= 1 else f"{1 / speed:.1f} s each", style="progress.data.speed")


class _Bar:
    """One bar of a rich display."""

    def __init__(self, display: Progress, task: TaskID) -> None:
        self._display = display
        self._task = task

    def advance(self, units: int = 1) -> None:
        self._display.advance(self._task, units)

    def note(self, text: str) -> None:
        self._display.update(self._task, note=text)


class RichProgress:
    """Bars of the stage that is running, shown while at least one is open."""

    def __init__(self, console: Console) -> None:
        self._display = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            _RateColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", style="dim"),
            console=console,
            speed_estimate_period=60,
        )
        self._open = 0

    @contextmanager
    def task(self, label: str, total: int, done: int = 0) -> Iterator[contract.Task]:
        """Open a bar that begins at `done` of `total`: resumed work counts, but not towards the rate."""
        if self._open == 0:
            self._display.start()
        self._open += 1
        task = self._display.add_task(label, total=total, completed=done, note="")
        try:
            yield _Bar(self._display, task)
        finally:
            self._open -= 1
            self._display.stop_task(task)
            if self._open == 0:
                self._display.stop()
            self._display.remove_task(task)

    def stopping(self) -> bool:
        return interrupts.requested()


class _Quiet(contract.Silent):
    """No bars."""

    def stopping(self) -> bool:
        return interrupts.requested()


def make_progress(quiet: bool) -> contract.Progress:
    """Bars on stderr; none when `quiet` or when stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        return cast(contract.Progress, _Quiet())
    return cast(contract.Progress, RichProgress(Console(stderr=True)))
