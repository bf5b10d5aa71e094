"""Ctrl-C and SIGTERM: once, work that can be resumed finishes its episode and keeps it; Ctrl-C twice stops now."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_NOTICE = b"\nstopping at the next whole episode or epoch, which is kept (Ctrl-C again: now)\n"


class _Wish:
    """What the signals of this process have asked for."""

    def __init__(self) -> None:
        self.finishing = False  # a stage is at work that looks at `requested` from time to time
        self.requested = False

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """A signal's handler: it runs between two instructions of the main thread."""
        del frame
        if not self.finishing or (self.requested and number == signal.SIGINT):
            raise KeyboardInterrupt
        if not self.requested:
            self.requested = True
            os.write(2, _NOTICE)  # not through rich, which may be in the middle of a line


_wish = _Wish()


def install() -> None:
    """Have Ctrl-C and SIGTERM ask before they end this process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _wish.on_signal)


def over() -> None:
    """Nothing is left to stop: a signal while the interpreter ends would only end it with another exit code."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) == _wish.on_signal:
            signal.signal(number, signal.SIG_IGN)


def requested() -> bool:
    """Somebody asked to stop: finish the episode, keep it, and raise KeyboardInterrupt."""
    return _wish.requested


@contextmanager
def finishing() -> Iterator[None]:
    """A block whose work asks `requested` after every whole piece.

    Raises:
        KeyboardInterrupt: it was asked for before the block, during one that had ended anyway.
    """
    if _wish.requested:
        raise KeyboardInterrupt
    _wish.finishing = True
    try:
        yield
    finally:
        _wish.finishing = False
