"""The manifest every artifact carries (SPEC §2)."""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import from_json

from schemas.config import flatten
from schemas.errors import ArtifactError
from schemas.tables import SCHEMA_VERSION

MANIFEST = "manifest.json"

PLACEMENT = ("collect.workers",)
"""Configuration that says where the work is done and cannot change its result: not part of an artifact's identity."""
STUDIES = "studies"
"""A report's configuration says which of its inputs are whose study's: not its identity, for it follows its inputs."""

Stage = Literal["collect", "train-perception", "train-policy", "relabel", "analyze"]
Status = Literal["running", "complete", "failed"]


class InputRef(BaseModel):
    """An input artifact, pinned by the hash of its manifest."""

    model_config = ConfigDict(extra="forbid")
    id: str
    manifest_sha256: str


def _below(path: str) -> str:
    parts = path.split("/")
    if path == MANIFEST or not {"", ".", ".."}.isdisjoint(parts):
        raise ValueError("a file of an artifact lies below its directory, and is not its manifest")
    return path


class FileRef(BaseModel):
    """A file of the artifact; `path` is relative to the artifact's directory."""

    model_config = ConfigDict(extra="forbid")
    path: Annotated[str, AfterValidator(_below)]
    bytes: Annotated[int, Field(ge=0, lt=2**63)]
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
    device: str | None = None  # its networks ran on: cpu | cuda; older manifests do not say
    packages: dict[str, str]


class Origin(BaseModel):
    """What made a part of an artifact, and on what."""

    code: Code
    environment: Environment


class MissingSettingError(ArtifactError, KeyError):
    """A manifest's configuration lacks a key."""

    def __init__(self, key: str) -> None:
        super().__init__(f"a manifest's config has no {key!r}: it was made by another program; make the artifact again")

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError would put it in quotes


class Settings(dict[str, Any]):
    """A manifest's configuration: who needs a key that it lacks learns that the artifact is foreign."""

    def __init__(self, values: dict[str, Any]) -> None:
        super().__init__({key: Settings(each) if isinstance(each, dict) else each for key, each in values.items()})

    def __missing__(self, key: str) -> Any:
        raise MissingSettingError(key)


class Manifest(BaseModel):
    """Identity, lineage and contents of one artifact."""

    id: str  # KIND/NAME or runs/NAME/CELL, relative to the data root
    stage: Stage
    name: str
    schema_version: int = SCHEMA_VERSION
    status: Status
    created_at: str  # ISO 8601, UTC
    config: Annotated[dict[str, Any], AfterValidator(lambda config: Settings(config))]
    config_sha256: str
    inputs: list[InputRef]
    code: Code
    environment: Environment
    resumed_from: list[Origin] = []  # what began it, where that was not what ended it; oldest first
    files: list[FileRef] = []
    summary: dict[str, Any] = {}
    seal: str | None = None  # SHA-256 of all the others, once the artifact is finished

    @property
    def origins(self) -> list[Origin]:
        """Everything that made a part of it; last, what ended it."""
        return [*self.resumed_from, Origin(code=self.code, environment=self.environment)]

    def sealed(self) -> "Manifest":
        """With the seal of what it says, or with none while it is running and says something else soon."""
        seal = None if self.status == "running" else _seal(from_json(self.model_dump_json()))
        return self.model_copy(update={"seal": seal})


def _seal(content: dict[str, Any]) -> str:
    return canonical_sha256({key: value for key, value in content.items() if key != "seal"})


def canonical_sha256(content: dict[str, Any]) -> str:
    """Hash of what JSON says of `content`, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def config_sha256(config: dict[str, Any]) -> str:
    """Hash of a resolved configuration, over its canonical JSON, without what cannot change the result."""
    identity = {key: value for key, value in flatten(config) if key not in (*PLACEMENT, STUDIES)}
    return canonical_sha256(identity)


def read_manifest(directory: Path) -> Manifest:
    """Manifest of the artifact in `directory`.

    Raises:
        ArtifactError: it is absent, truncated, foreign, or of a schema version that this code does not know.
    """
    path = directory / MANIFEST
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ArtifactError(
            f"{directory} has no {MANIFEST}, so it is no artifact of this pipeline: restore it, or move it away"
        ) from error
    except OSError as error:
        raise ArtifactError(f"{path} cannot be read ({error.strerror}): check its permissions") from error
    return parse_manifest(data, path)


def parse_manifest(data: bytes, path: Path) -> Manifest:
    """The manifest whose bytes are `data`, read from `path`; errors as `read_manifest`'s."""
    try:
        content = from_json(data, allow_inf_nan=False)
    except ValueError as error:
        raise ArtifactError(
            f"{path} is truncated or no JSON: restore it, or move its directory away and make the artifact again"
        ) from error
    _check_version(content, path)
    if content.get("seal") and content.get("status") != "running" and content["seal"] != _seal(content):
        raise ArtifactError(
            f"{path} is not what was written: restore it, or move its directory away and make the artifact again"
        )
    try:
        return Manifest.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ArtifactError(f"{path} is no manifest of this pipeline: {where}: {first['msg'].lower()}") from error


def _check_version(content: object, path: Path) -> None:
    """Before the fields are looked at: those of another version may differ. Versions count from 1; all are read."""
    version = content.get("schema_version") if isinstance(content, dict) else None
    if not isinstance(version, int) or version < 1:
        raise ArtifactError(f"{path} has no schema_version: it is no manifest of this pipeline")
    if version > SCHEMA_VERSION:
        raise ArtifactError(
            f"{path} was made by a newer version of the pipeline "
            f"(schema {version}; this one reads up to {SCHEMA_VERSION}): upgrade"
        )
