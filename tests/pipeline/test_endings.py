"""How commands end: exit codes and one short message."""

import errno
import json
import os
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path
from types import SimpleNamespace

import pytest

from pipeline.machine import require_sim
from schemas.errors import MachineError
from tests.pipeline.fakes import TINY, Run, Stages, answer, prepare, refused


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (MachineError("no OpenGL to render with"), 4, "no OpenGL to render with"),
        (OSError(errno.ENOSPC, "No space left on device"), 4, "the disk is full"),
        (
            ZeroDivisionError("division by zero"),
            4,
            "unexpected ZeroDivisionError: division by zero (--debug shows where)",
        ),
        (EOFError("End of file"), 4, "unexpected RuntimeError: end of a file: End of file"),  # click: 130
        (KeyboardInterrupt(), 130, "the same command with --resume goes on from the last checkpoint"),
    ],
)
def test_exit_codes(run: Run, stages: Stages, error: BaseException, code: int, message: str) -> None:
    stages.errors = {"collect": error}
    result = run("collect", *TINY)
    assert result.exit_code == code
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    refused(run("collect", *TINY), 2, "add --resume")
    assert answer(run("collect", *TINY, "--resume", "--json"))["did"] == "resumed"


def test_debug_shows_the_traceback(run: Run, stages: Stages) -> None:
    stages.errors = {"collect": ZeroDivisionError("division by zero")}
    result = run("collect", *TINY, "--debug")
    assert result.exit_code == 4
    assert "Traceback" in result.stderr


def test_errors_as_json(run: Run, stages: Stages) -> None:
    result = run("collect", "--set", "collect.foo=1", "--json")
    assert result.exit_code == 2
    error = json.loads(result.stdout)["error"]
    assert (error["exit_code"], error["type"]) == (2, "ConfigError")
    assert error["message"].startswith("unknown key collect.foo")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("collct",), "unknown command 'collct'; valid: collect, train-perception"),
        (("collect", "--nam", "x"), "--nam"),
        (("collect", "--name", "../x"), "name '../x' cannot be used"),
        (("collect", "--set", "collect.keep_fraction=1.5"), "collect.keep_fraction"),
        (("train-policy", "--set", "policy.td3.gamma=1"), "policy.td3.gamma"),
        (("analyze", "--set", "analyze.confidence=2"), "analyze.confidence"),
        (("collect", "--profile", "huge"), "unknown profile 'huge'"),
        (("train-policy", "--estimator", "../x"), "name '../x' cannot be used"),
        (("list", "models"), "unknown kind of artifact 'models'; valid: datasets, estimators, relabels, reports, runs"),
        (("show",), "Missing argument 'ARTIFACT'"),
    ],
)
def test_wrong_usage(run: Run, arguments: tuple[str, ...], message: str) -> None:
    refused(run(*arguments), 2, message)


def test_no_gl_is_said_before_anything_is_written(run: Run, stages: Stages, data: Path) -> None:
    stages.renderer = None
    refused(run("collect", *TINY), 4, "install EGL")
    assert not (data / "datasets" / "default").exists()
    assert run("train-policy", "--set", "policy.schemes=['oracle']").exit_code == 0  # nothing is rendered for it


@pytest.mark.skipif(find_library("OSMesa") is not None, reason="OSMesa is here")
@pytest.mark.parametrize("command", ["collect", "doctor"])
def test_a_really_missing_gl(data: Path, command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pipeline", command, "--data", str(data)],
        env=os.environ | {"MUJOCO_GL": "osmesa", "COLUMNS": "1000"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 4
    assert "install EGL (`apt-get install libegl1" in (done.stdout if command == "doctor" else done.stderr)
    assert done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1
    assert not (data / "datasets" / "default").exists()


def test_a_simulator_that_cannot_be_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> None:
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")  # what MuJoCo says without libEGL

    monkeypatch.setattr("pipeline.machine.import_module", broken)
    with pytest.raises(MachineError, match=r"MuJoCo cannot be loaded .*glGetError.*: see `pipeline doctor`"):
        require_sim()


def test_no_space_is_said_before_anything_is_written(
    run: Run, stages: Stages, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.steps.collect.space_needed", lambda config: 10**18)
    refused(run("collect", *TINY), 4, "1000000000.0 GB are needed")
    assert not (data / "datasets" / "default").exists()


@pytest.mark.parametrize(("command", "kind"), [("train-perception", "estimators"), ("train-policy", "runs")])
def test_no_space_to_train(
    run: Run, stages: Stages, data: Path, monkeypatch: pytest.MonkeyPatch, command: str, kind: str
) -> None:
    prepare(run, "collect", *(["train-perception"] if command == "train-policy" else []))
    monkeypatch.setattr("pipeline.artifacts.space.shutil.disk_usage", lambda path: SimpleNamespace(free=1000))
    refused(run(command, *TINY), 4, "free some, or choose another --data")
    assert not list((data / kind).rglob("manifest.json"))


def test_no_space_for_a_report(run: Run, stages: Stages, data: Path) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    stages.errors = {"analyze": OSError(errno.ENOSPC, "No space left on device")}
    refused(run("analyze"), 4, "the disk is full")
    assert list((data / "reports").iterdir()) == []


def test_a_refused_resume_can_be_resumed(run: Run, stages: Stages, monkeypatch: pytest.MonkeyPatch) -> None:
    stages.errors = {"collect": KeyboardInterrupt()}
    assert run("collect", *TINY).exit_code == 130
    stages.renderer = None
    refused(run("collect", *TINY, "--resume"), 4, "install EGL")
    assert answer(run("list", "--json"))["artifacts"][0]["status"] == "running"
    stages.renderer = "back again"
    assert answer(run("collect", *TINY, "--resume", "--json"))["did"] == "resumed"


def test_no_gpu_where_one_is_asked_for(run: Run, stages: Stages, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.machine.cuda_device", lambda: None)
    prepare(run, "collect")
    refused(run("train-perception", "--set", "perception.device=cuda"), 4, "finds no GPU")
