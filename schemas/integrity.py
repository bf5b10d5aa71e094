"""Whether a file of an artifact is what was written."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from schemas.errors import ArtifactError
from schemas.files import leads_out
from schemas.manifest import FileRef


def file_sha256(path: Path) -> str:
    """Hash of a file, streamed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_file(
    directory: Path, artifact_id: str, file: FileRef, sha256: Callable[[Path], str] | None = file_sha256
) -> None:
    """ArtifactError where `problem` has something to say."""
    if found := problem(directory, file, sha256):
        raise ArtifactError(f"{artifact_id} is damaged: {found}; try `pipeline repair {artifact_id}`, or make it again")


def problem(directory: Path, file: FileRef, sha256: Callable[[Path], str] | None = file_sha256) -> str | None:
    """What is wrong with a file of the artifact in `directory`; None when it is what was written.

    Its content is asked of `sha256`; with None its place and its size are all that counts.
    """
    path = directory / file.path
    if leads_out(path, directory):
        return f"{file.path} leads out of the artifact"
    try:
        size = path.stat().st_size
        if size != file.bytes:
            return f"{file.path} has {size:,} bytes instead of {file.bytes:,}"
        return None if sha256 is None or sha256(path) == file.sha256 else f"{file.path} is not what was written"
    except FileNotFoundError:
        return f"{file.path} is missing"
    except OSError as error:
        return f"{file.path} cannot be read ({error.strerror or error})"
