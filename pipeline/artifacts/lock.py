"""One writer per artifact."""

import fcntl
import os
from pathlib import Path

from filelock import FileLock, Timeout

from schemas.errors import ArtifactError, ConfigError
from schemas.files import leads_out

_PATIENCE = 0.5
"""[s] A reader that asks who writes holds the lock for a moment, too."""


def is_held(root: Path, artifact_id: str) -> bool:
    """Some process is writing the artifact now. Asked without writing: readers may not be allowed to."""
    try:
        lock = ArtifactLock(root, artifact_id).path.open("rb")
    except (FileNotFoundError, PermissionError):
        return False
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


class ArtifactLock:
    """Held while an artifact is written. The operating system releases it when the process ends, however it ends."""

    def __init__(self, root: Path, artifact_id: str) -> None:
        self._id, self._root = artifact_id, root
        self.path = root / ".locks" / f"{artifact_id.replace('/', '--')}.lock"
        self._lock = FileLock(self.path)

    def acquire(self) -> None:
        """Take the lock; ConfigError naming the holder when another process has it."""
        if leads_out(self.path, self._root):
            raise ArtifactError(f"{self.path.parent} is a link that leads out of the data root: remove it")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._lock.acquire(timeout=_PATIENCE, poll_interval=0.02)
        except Timeout as error:
            raise ConfigError(
                f"{self._id} is being written by another process ({self._holder()}): wait for it or use another --name"
            ) from error
        self.path.write_text(f"{os.getpid()}\n", encoding="ascii")

    def release(self) -> None:
        """Let the next writer in."""
        self._lock.release()

    def _holder(self) -> str:
        text = self.path.read_text(encoding="ascii", errors="replace").strip()
        return f"pid {text}" if text.isdigit() else "pid unknown"
