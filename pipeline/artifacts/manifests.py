"""Reading, writing and comparing manifests."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import schemas.manifest
from pipeline.artifacts.names import STAGE_OF
from schemas.config import flatten
from schemas.errors import ArtifactError
from schemas.files import write_bytes
from schemas.integrity import file_ref, file_sha256
from schemas.manifest import MANIFEST, PLACEMENT, STUDIES, FileRef, Manifest


def read_manifest(directory: Path, artifact_id: str) -> Manifest:
    """Manifest of the artifact in `directory`, which is to be `artifact_id`'s.

    Raises:
        ArtifactError: see `schemas.manifest.read_manifest`; or it is another artifact's.
    """
    manifest = schemas.manifest.read_manifest(directory)
    if manifest.id != artifact_id or manifest.stage != STAGE_OF[artifact_id.split("/")[0]]:
        raise ArtifactError(
            f"{directory / MANIFEST} belongs to {manifest.id!r} ({manifest.stage}), not to {artifact_id!r}: put it back"
        )
    return manifest


def write_manifest(manifest: Manifest, directory: Path) -> None:
    """Write atomically: the old manifest or the new one is there, never half of one."""
    write_bytes(manifest.sealed().model_dump_json(indent=2).encode() + b"\n", directory / MANIFEST)


def manifest_sha256(directory: Path) -> str:
    """Hash that pins an input."""
    return file_sha256(directory / MANIFEST)


def list_files(directory: Path) -> list[FileRef]:
    """Every file of an artifact but its manifest, with size and hash; hidden (temporary) files are left out."""
    return [
        file_ref(directory, path)
        for path in sorted(directory.rglob("*"))
        if path.is_file() and path != directory / MANIFEST and not path.name.startswith(".")
    ]


def differences(old: dict[str, Any], new: dict[str, Any], defaults: Mapping[str, Any] = {}) -> list[str]:
    """Leaves that differ, as `key: old → new`; `defaults` are of keys that `old` may lack."""
    before, after = dict(flatten(dict(defaults))) | dict(flatten(old)), dict(flatten(new))
    keys = sorted((before.keys() | after.keys()) - {*PLACEMENT, STUDIES})
    return [
        f"{key}: {before.get(key, 'absent')} → {after.get(key, 'absent')}"
        for key in keys
        if key not in before or key not in after or before[key] != after[key]
    ]
