"""Memory of this process and of the workers it started."""

import psutil


def resident_mb() -> float:
    """Proportional resident memory [MB] of this process and all its descendants: shared pages count once."""
    this = psutil.Process()
    return sum(process.memory_full_info().pss for process in [this, *this.children(recursive=True)]) / 1e6
