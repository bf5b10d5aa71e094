"""Manifests of the artifacts that replay reads."""

from pathlib import Path

from pydantic import ValidationError

from schemas.errors import ArtifactError
from schemas.manifest import Manifest
from schemas.tables import SCHEMA_VERSION


def read_manifest(directory: Path) -> Manifest:
    """The manifest of the artifact in `directory`.

    Raises:
        ArtifactError: it is missing, damaged or of a newer schema version.
    """
    path = directory / "manifest.json"
    try:
        manifest = Manifest.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ArtifactError(f"no artifact in {directory}: {path.name} cannot be read ({error.strerror})") from error
    except ValidationError as error:
        raise ArtifactError(f"{path} is damaged: {error.error_count()} invalid fields") from error
    if manifest.schema_version > SCHEMA_VERSION:
        raise ArtifactError(
            f"{path} has schema version {manifest.schema_version}, this version reads up to {SCHEMA_VERSION}; update it"
        )
    return manifest
