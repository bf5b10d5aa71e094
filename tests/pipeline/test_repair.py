"""`pipeline repair` of a file that was cut off."""

import json
from pathlib import Path

from mcap.writer import CompressionType

from tests.pipeline.fakes import Run, refused
from tests.schemas.test_mcap_recovery import read, write


def test_a_file_that_was_cut_off(run: Run, tmp_path: Path) -> None:
    sent = write(tmp_path / "a.mcap", CompressionType.NONE)
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(whole[: len(whole) // 2])
    found = json.loads(run("repair", tmp_path / "a.mcap", "--json").stdout)
    assert (found["is_whole"], found["repaired"]) == (False, str(tmp_path / "a-repaired.mcap"))
    kept = read(tmp_path / "a-repaired.mcap")
    assert 0 < len(kept) == found["messages"]["/topic"] < 60 and kept == sent[: len(kept)]
    refused(run("repair", tmp_path / "a.mcap"), 2, "a-repaired.mcap is there already")
    assert "messages of 1 topics kept" in run("repair", tmp_path / "a.mcap", "-o", tmp_path / "b.mcap").stdout
    assert (tmp_path / "a.mcap").read_bytes() == whole[: len(whole) // 2]


def test_what_cannot_be_repaired(run: Run, tmp_path: Path) -> None:
    refused(run("repair", tmp_path / "none.mcap"), 3, "there is no file")
    (tmp_path / "text.mcap").write_text("text")
    refused(run("repair", tmp_path / "text.mcap"), 3, "does not begin as an MCAP file does")
    assert [path.name for path in tmp_path.iterdir()] == ["text.mcap"]
