"""The manifest every artifact carries (SPEC §2)."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from schemas.tables import SCHEMA_VERSION

Stage = Literal["collect", "train-perception", "train-policy", "analyze"]
Status = Literal["running", "complete", "failed"]


class InputRef(BaseModel):
    """An input artifact, pinned by the hash of its manifest."""

    model_config = ConfigDict(extra="forbid")
    id: str
    manifest_sha256: str


class FileRef(BaseModel):
    """A file of the artifact; `path` is relative to the artifact's directory."""

    model_config = ConfigDict(extra="forbid")
    path: str
    bytes: int
    sha256: str


class Code(BaseModel):
    """Which code made the artifact."""

    version: str
    git_commit: str | None
    dirty: bool | None


class Environment(BaseModel):
    """What the artifact was made on: what may explain a difference between machines."""

    python: str
    platform: str
    cpu: str
    gpu: str | None
    gl_renderer: str | None
    packages: dict[str, str]


class Manifest(BaseModel):
    """Identity, lineage and contents of one artifact."""

    id: str  # KIND/NAME or runs/NAME/CELL, relative to the data root
    stage: Stage
    name: str
    schema_version: int = SCHEMA_VERSION
    status: Status
    created_at: str  # ISO 8601, UTC
    config: dict[str, Any]
    config_sha256: str
    inputs: list[InputRef]
    code: Code
    environment: Environment
    files: list[FileRef] = []
    summary: dict[str, Any] = {}
