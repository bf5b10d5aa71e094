"""The crash benchmark sees what is wrong."""

import shutil
from pathlib import Path

import pyarrow as pa
import pytest

from benchmarks.crash_checks import different, progress, unreadable
from schemas.files import write_bytes, write_parquet


@pytest.fixture
def artifact(tmp_path: Path) -> Path:
    """Tables, an estimator's card, and a file that is being written."""
    directory = tmp_path / "whole"
    (directory / "checkpoints" / "000004-000000").mkdir(parents=True)
    write_parquet(pa.table({"run": ["a"], "value": [float("nan")], "wall_time_s": [1.0]}), directory / "e.parquet")
    write_bytes(b"{}", directory / "manifest.json")
    (directory / ".half.parquet.tmp").write_bytes(b"PAR1")
    return directory


def copied(artifact: Path) -> Path:
    return Path(shutil.copytree(artifact, artifact.with_name("other")))


def test_what_is_one_artifact_s_own_makes_no_difference(artifact: Path) -> None:
    other = copied(artifact)
    write_parquet(pa.table({"run": ["b"], "value": [float("nan")], "wall_time_s": [2.0]}), other / "e.parquet")
    assert different(artifact, other) == [] == unreadable(other)


def test_a_value_or_a_file_does(artifact: Path) -> None:
    other = copied(artifact)
    write_parquet(pa.table({"run": ["b"], "value": [1.0], "wall_time_s": [2.0]}), other / "e.parquet")
    write_parquet(pa.table({"more": [1]}), other / "f.parquet")
    assert different(artifact, other) == ["f.parquet", "e.parquet"]


def test_a_published_file_that_is_cut_off(artifact: Path) -> None:
    (artifact / "e.parquet").write_bytes((artifact / "e.parquet").read_bytes()[:-3])
    [problem] = unreadable(artifact)
    assert problem.startswith("e.parquet: ")


def test_progress_never_goes_back_while_there_is_some(artifact: Path) -> None:
    assert progress(artifact) == 4_000_000
    (artifact / "checkpoints" / "000006-000000").mkdir()
    assert progress(artifact) == 6_000_000
    shutil.rmtree(artifact / "checkpoints")
    (artifact / "checkpoints").mkdir()
    assert progress(artifact) == 0
    write_bytes(b"{}", artifact / "checkpoints" / "policy.json")
    assert progress(artifact) > 6_000_000


def test_progress_of_an_estimator(tmp_path: Path) -> None:
    (tmp_path / "checkpoints").mkdir()
    for name in ("epoch-000001-0123456789abcdef.safetensors", ".epoch-000002-0123456789abcdef.safetensors.tmp"):
        (tmp_path / "checkpoints" / name).write_bytes(b"")
    assert progress(tmp_path) == 1


def test_work_that_has_ended_and_is_begun_again_is_lost(tmp_path: Path) -> None:
    """The estimator is there from before; only the manifest says that it is complete."""
    write_bytes(b"{}", tmp_path / "estimator.json")
    write_bytes(b'{"status": "running"}', tmp_path / "manifest.json")
    ended = progress(tmp_path)
    (tmp_path / "checkpoints").mkdir()
    write_bytes(b"", tmp_path / "checkpoints" / "epoch-000001-0123456789abcdef.safetensors")
    assert progress(tmp_path) == 1 < ended
    write_bytes(b'{"status": "complete"}', tmp_path / "manifest.json")
    assert progress(tmp_path) > ended
