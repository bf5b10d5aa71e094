"""Memory of this process and of the workers it started."""

from contextlib import suppress

import psutil


def resident_mb(without: int | None = None) -> float:
    """Proportional resident memory [MB] of this process and all its descendants: shared pages count once.

    The process with the id `without` does not count.
    """
    this = psutil.Process()
    total = 0
    for process in [this, *this.children(recursive=True)]:
        with suppress(psutil.NoSuchProcess):  # it ended meanwhile
            total += 0 if process.pid == without else process.memory_full_info().pss
    return total / 1e6
