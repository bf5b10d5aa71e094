"""The doctor's checks, each where it is well and where it is not."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from pipeline import doctor
from schemas.errors import MachineError
from tests.pipeline.fakes import Run, Stages


def test_versions(tmp_path: Path) -> None:
    lock = tmp_path / "requirements.lock"
    lock.write_text(f"click=={version('click')}\n")
    assert doctor.check_versions(lock) == doctor.Check("versions", True, "1 packages as in requirements.lock")
    lock.write_text("click==0.1\nno-such-package==1.0\n")
    found = doctor.check_versions(lock)
    assert found.found == f"click is {version('click')}, not 0.1; no-such-package is missing"
    assert (found.ok, found.remedy) == (False, "pip install --no-deps -r requirements.lock")


def test_a_build_tag_is_no_difference(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "lock").write_text("torch==2.13.0\n")
    monkeypatch.setattr(doctor, "version", lambda name: "2.13.0+cpu")
    assert doctor.check_versions(tmp_path / "lock").ok


def test_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.check_disk(tmp_path / "not" / "yet").found.endswith(f"GB free in {tmp_path}")
    monkeypatch.setattr(doctor, "NEEDED_FREE", 10**18)
    assert not doctor.check_disk(tmp_path).ok


def test_gl(stages: Stages) -> None:
    assert doctor.check_gl() == doctor.Check("gl", True, "test renderer")
    stages.renderer = None
    assert doctor.check_gl() == doctor.Check("gl", False, "none", "no OpenGL to render with; install EGL")


def test_gpu_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "cuda_device", lambda: None)
    assert doctor.check_gpu() == doctor.Check("gpu", True, "none: the CPU is used")


def test_command(run: Run, stages: Stages, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "check_versions", lambda lock: doctor.Check("versions", True, "all"))
    well = run("doctor", "--json")
    assert (well.exit_code, json.loads(well.stdout)["ok"]) == (0, True)
    stages.renderer = None
    ill = run("doctor")
    assert ill.exit_code == 4
    assert "install EGL" in ill.stdout
    assert ill.stderr == "Error: 1 of 5 checks failed: gl\n"
    report = json.loads(run("doctor", "--json").stdout)
    assert [check["name"] for check in report["checks"] if not check["ok"]] == ["gl"]


def test_no_gpu_where_one_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.machine import require_device

    monkeypatch.setattr("pipeline.machine.cuda_device", lambda: None)
    require_device("cpu")
    with pytest.raises(MachineError, match="finds no GPU"):
        require_device("cuda")


def test_the_table_is_plain_text(run: Run) -> None:
    """What is found comes from elsewhere: nothing in it is markup."""
    shown = run("doctor").stdout
    assert "\nok  " in shown and "[/]" not in shown
