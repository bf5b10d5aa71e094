"""A manifest is read whole, or what is wrong with it is said."""

import json
from pathlib import Path
from typing import Any

import pytest

from schemas.errors import ArtifactError
from schemas.manifest import Manifest, read_manifest
from schemas.tables import SCHEMA_VERSION

MANIFEST: dict[str, Any] = {
    "id": "datasets/small",
    "stage": "collect",
    "name": "small",
    "schema_version": SCHEMA_VERSION,
    "status": "complete",
    "created_at": "2026-01-02T03:04:05+00:00",
    "config": {},
    "config_sha256": "0" * 64,
    "inputs": [],
    "code": {"version": "0.1.0", "git_commit": None, "dirty": None},
    "environment": {"python": "3.11", "platform": "", "cpu": "", "gpu": None, "gl_renderer": None, "packages": {}},
}


def test_a_whole_manifest(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    manifest = read_manifest(tmp_path)
    assert (manifest.id, manifest.status, manifest.schema_version) == ("datasets/small", "complete", SCHEMA_VERSION)


def test_a_finished_manifest_is_sealed(tmp_path: Path) -> None:
    """Whatever it says: of a headline figure one digit is another, and nobody takes it for what was measured."""
    sealed = Manifest.model_validate(MANIFEST | {"summary": {"final_return": 173.875}}).sealed().model_dump_json()
    (tmp_path / "manifest.json").write_text(sealed)
    assert read_manifest(tmp_path).summary == {"final_return": 173.875}
    (tmp_path / "manifest.json").write_text(sealed.replace("173.875", "172.875"))
    with pytest.raises(ArtifactError, match=r"manifest\.json is not what was written: restore it"):
        read_manifest(tmp_path)


def test_a_running_manifest_is_not(tmp_path: Path) -> None:
    running = Manifest.model_validate(MANIFEST | {"status": "running"}).sealed()
    assert running.seal is None and running.model_copy(update={"status": "complete"}).sealed().seal


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is truncated or no JSON"),
        (json.dumps(MANIFEST).encode()[:-20], "is truncated or no JSON"),
        (b"\xff\xfe\x00", "is truncated or no JSON"),
        (b"[" * 100_000, "is truncated or no JSON"),
        (b"[]", "has no schema_version"),
        (b'{"name": "theirs"}', "has no schema_version"),
        (json.dumps(MANIFEST | {"schema_version": 0}).encode(), "has no schema_version"),
        (json.dumps(MANIFEST | {"schema_version": "1"}).encode(), "has no schema_version"),
        (json.dumps({"schema_version": SCHEMA_VERSION + 1}).encode(), "made by a newer version of the pipeline"),
        (json.dumps(MANIFEST | {"status": "done"}).encode(), "is no manifest of this pipeline: status"),
    ],
)
def test_what_is_wrong_is_said_with_the_file(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "manifest.json").write_bytes(content)
    with pytest.raises(ArtifactError, match=rf"manifest\.json .*{said}|manifest\.json {said}"):
        read_manifest(tmp_path)


def test_places_without_manifest(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "odd" / "manifest.json").mkdir(parents=True)
    for place in ("nowhere", "file"):
        with pytest.raises(ArtifactError, match=rf"{place} has no manifest\.json, so it is no artifact"):
            read_manifest(tmp_path / place)
    with pytest.raises(ArtifactError, match="cannot be read .Is a directory"):
        read_manifest(tmp_path / "odd")
