"""Reports on a matrix that is only partly finished, and the copy of a report that is kept as evidence."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.store import Store
from stages.analyze.evidence import PARTS
from tests.pipeline.fakes import TINY, Run, Stages, answer, prepare, refused

DENSE, ORACLE = "runs/default/reach-dense-orbit00-seed0", "runs/default/reach-oracle-orbit00-seed0"


@pytest.fixture
def partial(run: Run, stages: Stages, store: Store, edit: Callable[..., None]) -> None:
    """A matrix of two runs, one of which is still being trained."""
    prepare(run, "collect", "train-perception", "train-policy")
    edit(store.path(DENSE), status="running", files=[])


def test_of_a_name_the_finished_runs_count(run: Run, stages: Stages, store: Store, partial: None) -> None:
    made = answer(run("analyze", "--runs", "default", "--json"))
    assert stages.options["analyze"]["runs"] == [ORACLE.removeprefix("runs/")]
    assert made["left_out"] == [{"id": "runs/default", "unfinished": 1, "of": 2, "left_out": 1}]
    assert made["summary"]["runs_left_out"] == 1
    assert stages.options["analyze"]["left_out"] == {"default": 1}
    assert [ref.id for ref in load_complete(store.root, "reports/default").inputs] == [ORACLE, "estimators/default"]


@pytest.mark.parametrize("named", [(), ("--runs", "default")])
def test_what_is_left_out_is_said(run: Run, partial: None, named: tuple[str, ...]) -> None:
    said = "runs/default: 1 of 2 runs are not finished: they are left out of the report"
    assert run("analyze", *named, "--dry-run").stdout.count(said) == 1
    assert said in run("analyze", *named).stderr
    assert run("analyze", *named, "--quiet").output == ""


def test_a_run_that_is_being_trained_is_reported_on_when_it_is_named(run: Run, stages: Stages, partial: None) -> None:
    """Each time anew: its manifest does not tell how far it has come."""
    for _ in range(2):
        made = answer(run("analyze", "--runs", DENSE.removeprefix("runs/"), "--json"))
        assert (made["did"], made["left_out"]) == ("made", [])
    assert stages.options["analyze"]["runs"] == [DENSE.removeprefix("runs/")]
    assert stages.options["analyze"]["left_out"] == {}


@pytest.mark.parametrize("named", [(), ("--runs", "default")])
def test_where_nothing_is_finished_the_report_is_on_what_is_there(
    run: Run, stages: Stages, partial: None, store: Store, edit: Callable[..., None], named: tuple[str, ...]
) -> None:
    edit(store.path(ORACLE), status="running", files=[])
    assert answer(run("analyze", *named, "--json"))["left_out"] == []
    assert stages.options["analyze"]["runs"] == [each.removeprefix("runs/") for each in (DENSE, ORACLE)]


def test_the_plan_of_a_chain_waits_for_its_runs(
    run: Run, stages: Stages, store: Store, edit: Callable[..., None]
) -> None:
    """It reports on what it has trained, whatever `analyze` would make of it by now."""
    chain = ("run", "demo", *TINY)
    assert run(*chain).exit_code == 0
    edit(store.path(DENSE.replace("default", "demo")), status="running", files=[])
    plan = answer(run(*chain, "--dry-run", "--json"))["plan"]
    assert {step["id"]: step["plan"] for step in plan}["reports/demo"] == "make, once its inputs are there"


def test_a_report_follows_a_matrix_that_grows(
    run: Run, stages: Stages, partial: None, store: Store, edit: Callable[..., None]
) -> None:
    assert answer(run("analyze", "--runs", "default", "--json"))["did"] == "made"
    assert answer(run("analyze", "--runs", "default", "--json"))["did"] == "nothing"
    edit(store.path(DENSE), status="failed", summary={"error": "NaN"})
    made = answer(run("analyze", "--runs", "default", "--json"))
    assert (made["did"], made["left_out"], len(stages.options["analyze"]["runs"])) == ("made", [], 2)


@pytest.fixture
def evidence(tmp_path: Path) -> Path:
    """Where the evidence goes."""
    return tmp_path / "results" / "demo"


@pytest.mark.parametrize("command", [("run", "demo", *TINY), ("analyze", "--name", "demo")])
def test_evidence_is_copied(run: Run, stages: Stages, data: Path, evidence: Path, command: tuple[str, ...]) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    plan = answer(run(*command, "--evidence", evidence, "--dry-run", "--json"))["plan"]
    assert plan[-1] == {"id": str(evidence), "plan": "copy the report's evidence"}
    assert not evidence.exists()
    assert answer(run(*command, "--evidence", evidence, "--json"))["evidence"] == str(evidence)
    copied = sorted(path.relative_to(evidence).as_posix() for path in evidence.rglob("*") if path.is_file())
    assert copied == sorted(["README.md", "config.toml", "figures/of-2-runs", "provenance.json", "tables/of-2-runs"])
    for path in copied:
        assert (evidence / path).read_bytes() == (data / "reports" / "demo" / path).read_bytes()
    assert answer(run(*command, "--json"))["evidence"] is None


def test_evidence_is_copied_of_a_report_that_is_up_to_date(run: Run, stages: Stages, evidence: Path) -> None:
    prepare(run, "collect", "train-perception", "analyze")
    made = answer(run("analyze", "--evidence", evidence, "--json"))
    assert made["did"] == "nothing"
    assert (evidence / "README.md").read_text() == "README.md"


def test_stale_evidence_is_removed_and_other_files_are_not(run: Run, stages: Stages, evidence: Path) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    answer(run("analyze", "--runs", ORACLE.removeprefix("runs/"), "--evidence", evidence, "--json"))
    (evidence / "notes.txt").write_text("mine")
    (evidence / "tables" / "old").mkdir()
    (evidence / "tables" / "old" / "table.csv").write_text("1,2")
    assert (evidence / "tables" / "of-1-runs").exists()
    answer(run("analyze", "--runs", "default", "--evidence", evidence, "--json"))
    assert sorted(path.name for path in evidence.iterdir()) == sorted([*PARTS, "notes.txt"])
    for part in ("tables", "figures"):
        assert [path.name for path in (evidence / part).iterdir()] == ["of-2-runs"]


def test_an_earlier_evidence_is_added_to_when_asked(run: Run, stages: Stages, evidence: Path, tmp_path: Path) -> None:
    """The first of several is copied as it is; one of another version, or a flag without a directory, is refused."""
    prepare(run, "collect", "train-perception", "train-policy")
    command = ("analyze", "--evidence", evidence, "--accumulate")
    assert answer(run(*command, "--dry-run", "--json"))["plan"][-1]["plan"] == "add the report's evidence"
    answer(run(*command, "--json"))
    assert (evidence / "README.md").read_text() == "README.md"
    refused(run(*command), 3, f"the evidence in {evidence} cannot be read")  # the fake stage's are no tables
    for without in (("analyze",), ("run", "demo", *TINY)):
        refused(run(*without, "--accumulate"), 2, "name its directory with --evidence DIR")


def test_where_evidence_cannot_go(run: Run, stages: Stages, data: Path, tmp_path: Path) -> None:
    prepare(run, "collect", "train-perception")
    file = tmp_path / "file"
    file.write_text("text")
    ours = tmp_path / "ours"
    ours.mkdir()
    (ours / "README.md").write_text("ours")
    for directory, message in (
        (data / "reports" / "x", "lies inside the data root"),
        (tmp_path, "lies around the data root"),
        (file, f"{file} is no directory"),
        (file / "below", f"{file} is no directory"),
        (ours, "its README.md is of no earlier evidence"),
    ):
        for command in (("run", "demo"), ("analyze",)):
            refused(run(*command, "--evidence", directory), 2, message)
    assert stages.calls == ["collect", "train-perception"]


def test_evidence_where_nobody_may_write(
    run: Run, stages: Stages, evidence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(run, "collect", "train-perception")
    real = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path and real(path, mode))
    refused(run("analyze", "--evidence", evidence), 4, f"{evidence} cannot be written to (permission denied)")


@pytest.mark.parametrize("number", [errno.EACCES, errno.EROFS, errno.EISDIR])
def test_a_copy_that_fails_leaves_whole_files(
    run: Run, stages: Stages, evidence: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    prepare(run, "collect", "train-perception")
    answer(run("analyze", "--evidence", evidence, "--json"))

    def refuse(data: bytes, path: Path) -> None:
        raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr("pipeline.evidence.write_bytes", refuse)
    refused(run("analyze", "--evidence", evidence), 4, f"cannot be written to ({os.strerror(number).lower()})")
    assert (evidence / "README.md").read_text() == "README.md"


def test_a_report_of_an_older_version_has_no_evidence(
    run: Run, stages: Stages, evidence: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(run, "collect", "train-perception", "analyze")
    monkeypatch.setattr("pipeline.evidence.parts", lambda: (*PARTS, "claims.md"))
    refused(run("analyze", "--evidence", evidence), 3, "has no claims.md, for an older version made it")
    assert not evidence.exists()
