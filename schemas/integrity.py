"""Whether a file of an artifact is what was written."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from schemas.errors import ArtifactError
from schemas.files import leads_out
from schemas.manifest import MANIFEST, FileRef, Manifest, config_sha256

EDITED = f"the configuration in its {MANIFEST} is not the one it was made with"


def file_sha256(path: Path) -> str:
    """Hash of a file, streamed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def file_ref(directory: Path, path: Path) -> FileRef:
    """What a file of the artifact in `directory` is now."""
    return FileRef(path=path.relative_to(directory).as_posix(), bytes=path.stat().st_size, sha256=file_sha256(path))


def check_config(manifest: Manifest) -> None:
    """ArtifactError where the configuration in a manifest is not the one that the artifact was made with."""
    if config_sha256(manifest.config) != manifest.config_sha256:
        raise ArtifactError(f"{manifest.id} is damaged: {EDITED}; restore its manifest, or make it again")


def unlisted(directory: Path, manifest: Manifest) -> tuple[list[str], list[str]]:
    """Files of a finished artifact that its manifest does not know: what readers take for its data, and others."""
    known = {MANIFEST, *(file.path for file in manifest.files)}
    paths = (path for path in sorted(directory.rglob("*")) if path.is_file() and not path.name.startswith("."))
    names = [name for path in paths if (name := path.relative_to(directory).as_posix()) not in known]
    return [name for name in names if _is_data(name)], [name for name in names if not _is_data(name)]


def _is_data(name: str) -> bool:
    return name.startswith(("transitions/", "episodes/"))


def check_file(
    directory: Path, artifact_id: str, file: FileRef, sha256: Callable[[Path], str] | None = file_sha256
) -> None:
    """ArtifactError where `problem` has something to say."""
    if found := problem(directory, file, sha256):
        way_out = "" if artifact_id.startswith("reports/") else f"try `pipeline repair {artifact_id}`, or "
        raise ArtifactError(f"{artifact_id} is damaged: {found}; {way_out}make it again")


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
