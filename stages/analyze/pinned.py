"""Files of artifacts that are being written, as they were at one moment."""

import errno
import os
import re
import resource
from pathlib import Path

_OPEN_FILES = Path("/proc/self/fd")


class Pinned:
    """Keeps files open, so that readers who come back to them by name find the same ones.

    DuckDB opens a file anew for its columns after it has read where they are: by then a writer may have put another one
    in its place. Where the system has no names for open files they are read by their own.
    """

    def __init__(self) -> None:
        self._descriptors: list[int] = []

    def names(self, files: list[Path]) -> list[Path]:
        """What to read instead of these files; those that are gone since they were listed are left out."""
        if not _OPEN_FILES.is_dir():
            return files
        return [_OPEN_FILES / str(descriptor) for file in files if (descriptor := self._open(file)) is not None]

    def directories(self) -> list[Path]:
        """Where those names are, if there are any."""
        return [_OPEN_FILES] if self._descriptors else []

    def close(self) -> None:
        """Let go of the files."""
        while self._descriptors:
            os.close(self._descriptors.pop())

    def _open(self, file: Path) -> int | None:
        try:
            descriptor = os.open(file, os.O_RDONLY)
        except FileNotFoundError:
            return None
        except OSError as error:
            if error.errno != errno.EMFILE or not _allow_more():
                raise
            return self._open(file)
        self._descriptors.append(descriptor)
        return descriptor


def by_name(message: str) -> str:
    """The message with the names that people know the files by."""
    return re.sub(rf"{_OPEN_FILES}/\d+", lambda found: _name(found[0]), message)


def _name(open_file: str) -> str:
    try:
        return os.readlink(open_file).removesuffix(" (deleted)")
    except OSError:  # closed
        return open_file


def _allow_more() -> bool:
    """As many open files as this process may have; False where it has them already."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    return soft != hard
