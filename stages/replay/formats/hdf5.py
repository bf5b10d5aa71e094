"""HDF5 files on a disk that may fill up."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import h5py


class HDF5File:
    """A new file, `root` its first group; the first write that failed is raised by `check` and by `close`.

    HDF5 whose writes fail leaves its file half closed, and crashes the process at its end. So it is never told.
    """

    def __init__(self, path: Path, **options: Any) -> None:
        self._disk = _Disk(path, "w+")
        self.root = h5py.File(self._disk, "w", **options)

    def check(self) -> None:
        """Pass if all that was written is in the file, or in HDF5's buffers; OSError where the disk is full."""
        if self._disk.error is not None:
            raise self._disk.error

    def close(self) -> None:
        """Close the file; OSError as `check` raises it."""
        try:
            self.root.close()
        finally:  # what HDF5 says after a write that failed follows from that
            self._disk.close()
            self.check()


class _Disk(FileIO):
    """A file in which no write fails: `error` is the first that would have."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data)
        with self._noted():
            while rest:
                rest = rest[super().write(rest) :]
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        with self._noted():
            super().truncate(size)
        return size or 0

    @contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.error = self.error or error
