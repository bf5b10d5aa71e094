"""Which artifacts lie under a data root: whatever carries a manifest that names its own place."""

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from schemas.errors import ArtifactError, listed
from schemas.files import leads_out
from schemas.integrity import check_config, check_file, file_sha256, problem
from schemas.manifest import MANIFEST, FileRef, Manifest, parse_manifest
from stages.analyze.remembered import RememberedHashes

Kind = Literal["datasets", "estimators", "runs", "relabels"]

_DEPTH: dict[Kind, int] = {"datasets": 1, "estimators": 1, "runs": 2, "relabels": 2}  # directories below data/KIND
TRANSITIONS = "transitions/"
"""Where runs and relabels keep them."""
_THREADS = 4  # hashing is the disk's and the processor's work, not Python's


@dataclass(frozen=True)
class Artifact:
    """A directory with its manifest. `name` is NAME, or NAME/CELL for a run."""

    kind: Kind
    name: str
    path: Path
    manifest: Manifest
    manifest_bytes: bytes

    @property
    def id(self) -> str:
        """KIND/NAME, as in manifests."""
        return f"{self.kind}/{self.name}"

    @cached_property
    def manifest_sha256(self) -> str:
        """What another artifact's `inputs` pins."""
        return hashlib.sha256(self.manifest_bytes).hexdigest()

    def parquet(self, pattern: str) -> list[Path]:
        """Its finished Parquet files that match, in order: those it lists, or while it runs all but hidden ones."""
        found = sorted(path for path in self.path.glob(pattern) if not path.name.startswith("."))
        if self.manifest.status == "running":
            return [path for path in found if not leads_out(path, self.path)]
        listed = {file.path for file in self.manifest.files}
        return [path for path in found if path.relative_to(self.path).as_posix() in listed]


def artifacts(data_root: Path, kind: Kind) -> list[Artifact]:
    """All artifacts of a kind, by name. Directories without manifest, hidden and temporary ones are passed over.

    Raises:
        ArtifactError: a manifest is damaged, foreign or of a newer schema version. It is not passed over, for answers
            would then leave its artifact out without a word.
    """
    root = data_root.resolve()
    found = [_read(root, kind, path) for path in _directories(root / kind, _DEPTH[kind])]
    return [artifact for artifact in found if artifact is not None]


def _directories(parent: Path, depth: int) -> Iterator[Path]:
    if not parent.is_dir():
        return
    for path in sorted(parent.iterdir()):
        if path.name.startswith(".") or not path.is_dir():
            continue
        if depth == 1:
            yield path
        else:
            yield from _directories(path, depth - 1)


def _read(root: Path, kind: Kind, path: Path) -> Artifact | None:
    """The artifact at `path`; None where there is none, it is another's copy, or a link leads out of the data root."""
    name, manifest_path = path.relative_to(root / kind).as_posix(), path / MANIFEST
    if leads_out(manifest_path, root):
        return None
    try:
        data = manifest_path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ArtifactError(f"{manifest_path} cannot be read ({error.strerror}): check its permissions") from error
    manifest = parse_manifest(data, manifest_path)
    return Artifact(kind, name, path, manifest, data) if manifest.id == f"{kind}/{name}" else None


def select(found: Sequence[Artifact], names: Sequence[str]) -> list[Artifact]:
    """The artifacts named: NAME, NAME/CELL, or the same after KIND/. A run's NAME means all of its cells.

    Raises:
        ArtifactError: a name that no artifact has; the message lists those there are.
    """
    chosen: dict[str, Artifact] = {}
    for name in names:
        matches = [artifact for artifact in found if _is_named(artifact, name.strip("/"))]
        if not matches:
            valid = listed(name, {n for a in found for n in (a.name, a.name.split("/")[0])}) or "none there"
            raise ArtifactError(f"no readable artifact {name!r} under the data root; valid: {valid}")
        chosen.update({artifact.id: artifact for artifact in matches})
    return list(chosen.values())


def _is_named(artifact: Artifact, name: str) -> bool:
    name = name.removeprefix(f"{artifact.kind}/")
    return artifact.name == name or artifact.name.startswith(f"{name}/")


def check_files(artifact: Artifact) -> None:
    """Compare a complete artifact's Parquet files with its manifest: by content, but transitions by size.

    Transitions are all but a hundredth of the logs, and many questions read none: see `check_transitions`.

    Raises:
        ArtifactError: a file is missing, elsewhere, or not what was written.
    """
    if artifact.manifest.status == "complete":
        check_config(artifact.manifest)
    for file in _parquet(artifact):
        check_file(artifact.path, artifact.id, file, None if file.path.startswith(TRANSITIONS) else file_sha256)


def check_transitions(found: Sequence[Artifact]) -> None:
    """Compare the content of complete artifacts' transitions with their manifests, unless it was done before.

    What is remembered can but say that a file is whole: one that it says is not is read again.

    Raises:
        ArtifactError: a file is not what was written.
    """
    parts = [(each, file) for each in found for file in _parquet(each) if file.path.startswith(TRANSITIONS)]
    hashes = RememberedHashes()
    with ThreadPoolExecutor(_THREADS) as threads:
        checks = [threads.submit(_check_transitions, each, file, hashes) for each, file in parts]
        try:
            for check in checks:
                check.result()
        finally:
            threads.shutdown(cancel_futures=True)
            hashes.keep()


def _check_transitions(artifact: Artifact, file: FileRef, hashes: RememberedHashes) -> None:
    if problem(artifact.path, file, hashes.sha256):
        check_file(artifact.path, artifact.id, file)


def first_damaged(artifact: Artifact) -> str | None:
    """Of a complete artifact's Parquet files, transitions too, the first that is not what was written."""
    return next((file.path for file in _parquet(artifact) if problem(artifact.path, file)), None)


def _parquet(artifact: Artifact) -> list[FileRef]:
    """Those a complete artifact lists; of others nothing is known."""
    is_complete = artifact.manifest.status == "complete"
    return [file for file in artifact.manifest.files if is_complete and file.path.endswith(".parquet")]
