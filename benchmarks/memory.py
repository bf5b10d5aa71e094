"""Memory of this process and of the workers it started."""

import psutil


def resident_mb(without: int | None = None) -> float:
    """Proportional resident memory [MB] of this process and all its descendants: shared pages count once.

    The process with the id `without` does not count.
    """
    this = psutil.Process()
    counted = [process for process in [this, *this.children(recursive=True)] if process.pid != without]
    return sum(process.memory_full_info().pss for process in counted) / 1e6
