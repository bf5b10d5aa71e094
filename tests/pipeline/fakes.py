"""Stages that write a file or two instead of simulating and learning."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from click.testing import Result

from pipeline.artifacts.store import Build, Request, Store
from schemas.errors import MachineError
from stages.analyze.evidence import PARTS
from stages.policy.config import RunResult, RunSpec

Run = Callable[..., Result]

TINY = ("--set", "collect.episodes=2", "--set", "collect.steps=4", "--set", "policy.schemes=['dense', 'oracle']")


class Stages:
    """What the fake stages were called with; `errors` makes the next call of a stage raise."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.options: dict[str, dict[str, Any]] = {}
        self._given: list[tuple[str, dict[str, Any]]] = []
        self.errors: dict[str, BaseException] = {}
        self.failing_cells: dict[str, str] = {}
        self.renderer: str | None = "test renderer"

    def gl_renderer(self) -> str:
        if self.renderer is None:
            raise MachineError("no OpenGL to render with; install EGL")
        return self.renderer

    def called(self, stage: str, **options: Any) -> None:
        self.calls.append(stage)
        self.options[stage] = options
        self._given.append((stage, options))
        if stage in self.errors:
            raise self.errors.pop(stage)

    def calls_of(self, stage: str) -> list[dict[str, Any]]:
        return [options for called, options in self._given if called == stage]

    def collect(self, config: Any, out: Path, **options: Any) -> dict[str, Any]:
        (out / "episodes").mkdir(exist_ok=True)
        (out / "episodes" / "episode-000000.mcap").write_bytes(b"mcap")
        self.called("collect", config=config, out=out, **options)
        (out / "frames.parquet").write_bytes(b"frames")
        return {"episodes": config.collect.episodes, "frames": 2, "bytes": 4}

    def perception(self, config: Any, dataset: Path, out: Path, **options: Any) -> dict[str, Any]:
        self.called("train-perception", config=config, dataset=dataset, out=out, **options)
        (out / "estimator.safetensors").write_bytes(b"weights")
        return {"test_mean_error": 0.014, "epochs": config.epochs}

    def policy(self, specs: list[RunSpec], estimator: Path | None, **options: Any) -> None:
        for spec in specs:
            (spec.out / "episodes.parquet").write_bytes(b"episodes")
        self.called("train-policy", specs=specs, estimator=estimator, **options)
        for spec in specs:
            options["finished"](self._result(spec))

    def _result(self, spec: RunSpec) -> RunResult:
        if reason := self.failing_cells.get(spec.scheme):
            return RunResult(spec.run_id, "failed", {"episodes": 1}, reason)
        return RunResult(spec.run_id, "complete", {"episodes": 3, "final_return": 170.0, "final_success_rate": 1.0})

    def analyze(self, config: Any, data_root: Path, runs: list[str], estimators: list[str], out: Path, **options: Any):
        self.called("analyze", config=config, runs=runs, estimators=estimators, **options)
        for part in PARTS:
            if "." in part:
                (out / part).write_text(part)
            else:
                (out / part).mkdir(exist_ok=True)
                (out / part / f"of-{len(runs)}-runs").write_text(part)
        (out / "report.html").write_text("<html>")
        (out / "comparison.rrd").write_bytes(b"rrd")
        return {"runs": len(runs)}


def begin(store: Store, request: Request, resume: bool = False) -> Build:
    """Start an artifact that is not complete yet."""
    build = store.begin(request, resume)
    assert isinstance(build, Build)
    return build


def answer(result: Result) -> dict[str, Any]:
    """The one JSON object of a command that succeeded."""
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(result: Result, code: int, message: str) -> None:
    """One short message on stderr, nothing on stdout."""
    assert result.exit_code == code, result.output
    assert message in result.stderr
    assert result.stderr.startswith("Error: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


def prepare(run: Run, *commands: str) -> None:
    for command in commands:
        assert run(command, *TINY).exit_code == 0
