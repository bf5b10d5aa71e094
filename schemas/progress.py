"""How a stage reports long work without knowing the terminal."""

from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Task(Protocol):
    """One bar: `advance` by whole units, `note` a short text of live figures beside it."""

    def advance(self, units: int = 1) -> None: ...

    def note(self, text: str) -> None: ...


class Progress(Protocol):
    """Opens bars. Implemented with rich by the command line, by `Silent` elsewhere."""

    def task(self, label: str, total: int, done: int = 0) -> AbstractContextManager[Task]: ...

    def stopping(self) -> bool:
        """Whether to stop: a stage then keeps the episode (epoch) it has just finished and raises KeyboardInterrupt."""


class _SilentTask:
    def advance(self, units: int = 1) -> None:
        del units

    def note(self, text: str) -> None:
        del text


class Silent:
    """Progress that shows nothing."""

    def task(self, label: str, total: int, done: int = 0) -> AbstractContextManager[Task]:
        del label, total, done
        return nullcontext(_SilentTask())

    def stopping(self) -> bool:
        return False
