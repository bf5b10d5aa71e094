"""Ending a recording that goes to a file: Rerun writes in a thread that tells nobody when the disk is full."""

import errno
import os
import shutil
from pathlib import Path

import rerun as rr

_PATIENCE = 60.0  # [s]: without a limit a flush to a full disk may wait for good
_END = b"RRF2FOOT"  # of the footer, which is written last
_TAIL = 16  # bytes that hold it
_FULL = 100_000  # bytes free, with which a disk is too full for the part that is missing


def end_recording(recording: rr.RecordingStream, path: Path) -> None:
    """Write what is left of `recording` to the file `path`, and close it.

    Raises:
        OSError: not all of it is there.
    """
    try:
        recording.flush(timeout_sec=_PATIENCE)
        recording.disconnect()
    except RuntimeError as error:
        raise _cause(path) from error
    if not _has_end(path):
        raise _cause(path)


def _has_end(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-min(_TAIL, path.stat().st_size), os.SEEK_END)
        return _END in file.read()


def _cause(path: Path) -> OSError:
    """Rerun keeps the reason to itself."""
    code = errno.ENOSPC if shutil.disk_usage(path.parent).free < _FULL else errno.EIO
    return OSError(code, os.strerror(code), str(path))
