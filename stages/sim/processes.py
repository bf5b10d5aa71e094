"""What worker processes have in common."""

import os
import pickle
import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from multiprocessing.connection import wait


@contextmanager
def interrupts_ignored(*also: signal.Signals) -> Iterator[None]:
    """Processes started in this block ignore Ctrl-C, and what else is named, from their first instruction on.

    It reaches the whole process group, and the parent decides; a worker still importing would print a traceback.
    """
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, *also)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def portable(error: Exception) -> Exception:
    """The error as it may be sent to the parent, which reports it; where it came from goes along as a note."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # some libraries' errors cannot be made from their arguments again
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_with_parent() -> None:
    """Wait for the parent's end and follow it: a killed parent sends no word, and its processes would stay for good.

    For a thread of its own.
    """
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def stay_on_own_cores(index: int, count: int) -> None:
    """Keep this process, the `index`-th of `count`, on its share of the cores, where together they take all.

    Moved about, it finds its caches cold: one in twenty steps. Where cores are to spare the system knows better.
    """
    if hasattr(os, "sched_setaffinity") and available_cores() % count == 0:
        cores, each = sorted(os.sched_getaffinity(0)), available_cores() // count
        os.sched_setaffinity(0, cores[index * each : (index + 1) * each])
