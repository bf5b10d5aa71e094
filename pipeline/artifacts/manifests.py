"""Reading, writing and comparing manifests."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.artifacts.names import STAGE_OF
from schemas.errors import ArtifactError
from schemas.files import write_bytes
from schemas.manifest import FileRef, Manifest
from schemas.tables import SCHEMA_VERSION

MANIFEST = "manifest.json"
PLACEMENT = ("collect.workers",)
"""Configuration that says where the work is done and cannot change its result: not part of an artifact's identity."""


def read_manifest(directory: Path, artifact_id: str) -> Manifest:
    """Manifest of the artifact in `directory`; ArtifactError when absent, truncated, foreign or from newer code."""
    path = directory / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ArtifactError(f"{directory} has no {MANIFEST}: it is no artifact of this pipeline") from error
    except (ValueError, UnicodeDecodeError) as error:
        raise ArtifactError(f"{path} is truncated or no JSON: make the artifact again under another --name") from error
    _check_version(content, path)
    manifest = _parse(content, path)
    if manifest.id != artifact_id or manifest.stage != STAGE_OF[artifact_id.split("/")[0]]:
        raise ArtifactError(
            f"{path} belongs to {manifest.id!r} ({manifest.stage}), not to {artifact_id!r}: put it back"
        )
    return manifest


def _check_version(content: object, path: Path) -> None:
    version = content.get("schema_version") if isinstance(content, dict) else None
    if not isinstance(version, int) or version < 1:
        raise ArtifactError(f"{path} has no schema_version: it is no manifest of this pipeline")
    if version > SCHEMA_VERSION:
        raise ArtifactError(
            f"{path} was made by a newer version (schema {version}; this one reads up to {SCHEMA_VERSION}): upgrade"
        )


def _parse(content: dict[str, Any], path: Path) -> Manifest:
    try:
        return Manifest.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ArtifactError(f"{path} is no manifest of this pipeline: {where}: {first['msg'].lower()}") from error


def write_manifest(manifest: Manifest, directory: Path) -> None:
    """Write atomically: the old manifest or the new one is there, never half of one."""
    write_bytes(manifest.model_dump_json(indent=2).encode() + b"\n", directory / MANIFEST)


def manifest_sha256(directory: Path) -> str:
    """Hash that pins an input."""
    return file_sha256(directory / MANIFEST)


def file_sha256(path: Path) -> str:
    """Hash of a file, streamed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def list_files(directory: Path) -> list[FileRef]:
    """Every file of an artifact but its manifest, with size and hash; hidden (temporary) files are left out."""
    return [
        FileRef(path=path.relative_to(directory).as_posix(), bytes=path.stat().st_size, sha256=file_sha256(path))
        for path in sorted(directory.rglob("*"))
        if path.is_file() and path != directory / MANIFEST and not path.name.startswith(".")
    ]


def config_sha256(config: dict[str, Any]) -> str:
    """Hash of a resolved configuration, over its canonical JSON, without what cannot change the result."""
    identity = {key: value for key, value in flatten(config) if key not in PLACEMENT}
    return hashlib.sha256(json.dumps(identity, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def flatten(config: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a nested configuration as (section.key, value)."""
    for key, value in config.items():
        if isinstance(value, dict) and value:
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Leaves that differ, as `key: old → new`."""
    before, after = dict(flatten(old)), dict(flatten(new))
    keys = sorted((before.keys() | after.keys()) - set(PLACEMENT))
    return [
        f"{key}: {before.get(key, 'absent')} → {after.get(key, 'absent')}"
        for key in keys
        if key not in before or key not in after or before[key] != after[key]
    ]
