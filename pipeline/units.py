"""Quantities as people read them."""

from typing import Any

_MOST = 10**24
"""[bytes] More than any disk has."""


def duration(seconds: float) -> str:
    """1 h 02 min, 3 min 20 s, 4.1 s."""
    if seconds >= 3600:
        return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"
    return f"{int(seconds // 60)} min {int(seconds % 60):02d} s" if seconds >= 60 else f"{seconds:.1f} s"


def size(count: Any) -> str:
    """1.2 GB; what is no number of bytes as it is."""
    if not isinstance(count, (int, float)) or not 0 <= count < _MOST:
        return figure(count)
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def figure(value: Any) -> str:
    """A value of a summary: floats to four digits, absent as a dash."""
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
