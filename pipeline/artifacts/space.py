"""Room on the disk, asked before work starts."""

import errno
import shutil
from pathlib import Path

from pipeline.units import size
from schemas.errors import MachineError

_FULL = (errno.ENOSPC, errno.EDQUOT)


def require_space(directory: Path, needed: int) -> None:
    """MachineError unless the file system of `directory` (or its first existing parent) has `needed` bytes free."""
    there = next(path for path in (directory, *directory.absolute().parents) if path.exists())
    free = shutil.disk_usage(there).free
    if free < needed:
        raise MachineError(
            f"{there} has {size(free)} free, about {size(needed)} are needed: free some, or choose another --data"
        )


def is_disk_full(error: BaseException) -> bool:
    """The error says that the disk, or the user's share of it, is full, whichever library raised it."""
    return (isinstance(error, OSError) and error.errno in _FULL) or "No space left on device" in str(error)
