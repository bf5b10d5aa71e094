"""Which artifacts lie under a data root: whatever carries a manifest that names its own place."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from schemas.errors import ArtifactError, listed
from schemas.files import leads_out
from schemas.manifest import MANIFEST, Manifest, parse_manifest

Kind = Literal["datasets", "estimators", "runs", "relabels"]

_DEPTH: dict[Kind, int] = {"datasets": 1, "estimators": 1, "runs": 2, "relabels": 2}  # directories below data/KIND


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

    Transitions are all but a hundredth of the logs, and many questions read none: `pipeline verify` and the stages that
    read them compare their content.

    Raises:
        ArtifactError: a file is missing, elsewhere, or not what was written.
    """
    if artifact.manifest.status != "complete":
        return
    for file in artifact.manifest.files:
        path = artifact.path / file.path
        if not file.path.endswith(".parquet"):
            continue
        if leads_out(path, artifact.path):
            raise ArtifactError(f"{artifact.id}: {file.path!r} leads out of the artifact; make it again")
        if not path.is_file():
            raise ArtifactError(f"{artifact.id}: {file.path} is missing; restore it or make the artifact again")
        if path.stat().st_size != file.bytes:
            raise ArtifactError(
                f"{artifact.id}: {file.path} has {path.stat().st_size} bytes, its manifest says {file.bytes}; "
                "restore it or make the artifact again"
            )
        if not file.path.startswith("transitions/") and _sha256(path) != file.sha256:
            raise ArtifactError(
                f"{artifact.id} is damaged: {file.path} is not what was written; restore it or make the artifact again"
            )


def first_damaged(artifact: Artifact) -> str | None:
    """Of a complete artifact's Parquet files, transitions too, the first whose content is not what was written."""
    if artifact.manifest.status != "complete":
        return None
    parquet = (file for file in artifact.manifest.files if file.path.endswith(".parquet"))
    return next((file.path for file in parquet if _sha256(artifact.path / file.path) != file.sha256), None)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
