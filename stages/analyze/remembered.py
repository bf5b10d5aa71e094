"""Hashes of files, computed once and remembered for as long as a file is the same one, unchanged."""

import json
import time
from contextlib import suppress
from pathlib import Path

from filelock import FileLock, Timeout

from schemas.cache import cache_directory
from schemas.files import write_bytes
from schemas.integrity import file_sha256

_FILE = "sha256.json"
_SETTLED = 2_000_000_000  # [ns] since the last change: one more in the same tick of the clock would not be seen
_MOST = 100_000  # entries, some 15 MB; the oldest go first


class RememberedHashes:
    """SHA-256 by what the file system says of a file: device, inode, size, and the moments of its last changes.

    Nobody can set the last of these (ctime), so a file that was written to since is hashed anew. What rots on the disk
    meanwhile is seen by `pipeline verify` alone. Where nothing can be kept every file is hashed each time.
    """

    def __init__(self) -> None:
        directory = cache_directory()
        self._path = directory / _FILE if directory else None
        self._known = _read(self._path)
        self._new: dict[str, str] = {}

    def sha256(self, path: Path) -> str:
        """Hash of the file's content; OSError where it cannot be read. Callable from any thread."""
        key = _identity(path)
        found = self._known.get(key)
        if found is None:
            begun = time.time_ns()
            found = file_sha256(path)
            settled = begun - path.stat().st_ctime_ns > _SETTLED
            if settled and _identity(path) == key:  # nobody wrote to it meanwhile
                self._new[key] = found
        return found

    def keep(self) -> None:
        """Remember what was hashed, beside what others have remembered meanwhile."""
        if not self._new or self._path is None:
            return
        merged = _read(self._path) | self._new
        latest = dict(list(merged.items())[-_MOST:])
        with suppress(OSError, Timeout):  # a home that cannot be written to costs time, nothing else
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(self._path.with_suffix(".lock"), timeout=0):  # who writes at the same time forgets
                write_bytes(json.dumps(latest).encode(), self._path)


def _identity(path: Path) -> str:
    status = path.stat()
    return f"{status.st_dev} {status.st_ino} {status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}"


def _read(path: Path | None) -> dict[str, str]:
    try:
        known = json.loads(path.read_bytes()) if path else {}
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}
