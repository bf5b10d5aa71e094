"""Hashes that are remembered: computed once per file, and anew for what has changed."""

import json
import os
from pathlib import Path

import pytest

from schemas.integrity import file_sha256
from stages.analyze import remembered
from stages.analyze.catalogue import artifacts, check_transitions
from stages.analyze.remembered import RememberedHashes
from tests.analyze.fake_runs import write_run


@pytest.fixture(autouse=True)
def kept_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    cache = tmp_path / "cache"
    monkeypatch.setenv("PIPELINE_CACHE", str(cache))
    monkeypatch.setattr(remembered, "_SETTLED", 0)
    return cache


def asked(path: Path) -> str:
    """As a new process asks."""
    hashes = RememberedHashes()
    found = hashes.sha256(path)
    hashes.keep()
    return found


def test_a_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "part"
    file.write_bytes(b"transitions")
    first = asked(file)
    assert first == file_sha256(file)
    monkeypatch.setattr(remembered, "file_sha256", lambda path: pytest.fail("read again"))
    assert asked(file) == first


def test_one_that_was_written_to_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "part"
    file.write_bytes(b"transitions")
    before, first = file.stat(), asked(file)
    file.write_bytes(b"transitionz")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))  # as a copy that keeps times would
    assert asked(file) == file_sha256(file) != first


@pytest.mark.parametrize("content", [b"", b"[", b"[1]", b"\xff"])
def test_a_damaged_memory_is_begun_anew(tmp_path: Path, kept_here: Path, content: bytes) -> None:
    file = tmp_path / "part"
    file.write_bytes(b"transitions")
    first = asked(file)
    (kept_here / "sha256.json").write_bytes(content)
    assert asked(file) == first
    assert {each.name for each in kept_here.iterdir()} <= {"sha256.json", "sha256.lock"}


def test_one_that_was_written_just_now_is_not_remembered(
    tmp_path: Path, kept_here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remembered, "_SETTLED", 10**12)
    file = tmp_path / "part"
    file.write_bytes(b"transitions")
    assert asked(file) == file_sha256(file)
    assert not (kept_here / "sha256.json").exists()


@pytest.mark.parametrize("lie", ["0" * 64, [1]])
def test_a_memory_that_lies_does_no_harm(tmp_path: Path, kept_here: Path, lie: object) -> None:
    run = write_run(tmp_path)
    [artifact] = artifacts(tmp_path, "runs")
    check_transitions([artifact])
    known = json.loads((kept_here / "sha256.json").read_bytes())
    assert len(known) == len(list(run.glob("transitions/*")))
    (kept_here / "sha256.json").write_text(json.dumps(dict.fromkeys(known, lie)))
    check_transitions([artifact])


def test_without_a_place_to_keep_them_they_are_computed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "part"
    file.write_bytes(b"transitions")
    for place in ("", str(file)):  # none, and one that cannot be a directory
        monkeypatch.setenv("PIPELINE_CACHE", place)
        assert asked(file) == file_sha256(file)


def test_the_oldest_are_forgotten_first(tmp_path: Path, kept_here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remembered, "_MOST", 2)
    files = [tmp_path / name for name in "abc"]
    for file in files:
        file.write_text(file.name)
        asked(file)
    monkeypatch.setattr(remembered, "file_sha256", lambda path: pytest.fail(f"{path.name} was forgotten"))
    assert [asked(file) for file in files[1:]]
    with pytest.raises(pytest.fail.Exception, match="a was forgotten"):
        asked(files[0])
