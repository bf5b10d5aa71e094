"""How commands end: exit codes and one short message."""

import errno
import json
from pathlib import Path

import pytest

from pipeline.machine import require_sim
from schemas.errors import Interrupted, MachineError
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
        (KeyboardInterrupt(), 130, "the same command with --resume goes on from there"),
        (Interrupted("stopped after episode 3"), 130, "stopped after episode 3"),
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
        (("collect", "--profile", "huge"), "unknown profile 'huge'"),
        (("train-policy", "--estimator", "../x"), "name '../x' cannot be used"),
        (("list", "models"), "unknown kind of artifact 'models'; valid: datasets, estimators, reports, runs"),
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


def test_no_gpu_where_one_is_asked_for(run: Run, stages: Stages, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.machine.cuda_device", lambda: None)
    prepare(run, "collect")
    refused(run("train-perception", "--set", "perception.device=cuda"), 4, "finds no GPU")
