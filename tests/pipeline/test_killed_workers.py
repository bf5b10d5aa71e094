"""A worker process is killed, as the kernel does when memory runs out: one message, nobody left over, --resume."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.pipeline.tiny_pipeline import ARTIFACTS, PAIR, arguments, check_kept, check_resumed, pipeline

_PATIENCE = 120.0  # [s]
COLLECT = {"collect__episodes": 40}


def workers(process: psutil.Process) -> list[psutil.Process]:
    """Spawned processes below it, the deepest last."""
    return [each for each in process.children(recursive=True) if "spawn_main" in " ".join(each.cmdline())]


def kill_one(data: Path, begun: Callable[[], bool], index: int, command: str, **settings: Any) -> tuple[int, str]:
    """Start a stage, kill a worker once it has `begun`; exit code and what it said."""
    started = [sys.executable, "-m", "pipeline", *arguments(command, data, **settings)]
    process = subprocess.Popen(started, stderr=subprocess.PIPE, text=True)
    try:
        until = time.monotonic() + _PATIENCE
        while not begun():
            assert process.poll() is None and time.monotonic() < until, "it ended before it could be killed"
            time.sleep(0.01)
        family = workers(psutil.Process(process.pid))
        os.kill(family[index].pid, signal.SIGKILL)
        _, said = process.communicate(timeout=_PATIENCE)
    finally:
        process.kill()
    _, left = psutil.wait_procs(family, timeout=10)
    assert not left, "a process is left over"
    return process.returncode, said


def check_said(ended: tuple[int, str], who: str) -> None:
    code, said = ended
    assert code == 4, said
    assert said.startswith("Error: ") and said.count("\n") == 1, said
    assert who in said and "--resume" in said


def test_a_worker_that_collects(tmp_path: Path) -> None:
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    dataset = killed / ARTIFACTS["collect"]
    ended = kill_one(killed, lambda: any(dataset.glob("episodes/*.mcap")), 0, "collect", collect__workers=2, **COLLECT)
    check_said(ended, "a collect worker died")
    assert 1 <= len(list(dataset.glob("episodes/*"))) < 40
    check_kept(dataset)
    assert pipeline("collect", whole, **COLLECT).exit_code == 0
    check_resumed(whole, killed, "collect", **COLLECT)


@pytest.mark.parametrize(
    ("workers_of_each", "killed", "who"), [(0, 0, "a training process died"), (1, -1, "a simulation worker died")]
)
def test_a_process_that_trains_or_simulates(
    whole_pair: Path, tmp_path: Path, workers_of_each: int, killed: int, who: str
) -> None:
    settings = PAIR | {"policy__workers": workers_of_each}

    def begun() -> bool:
        return any(tmp_path.glob("runs/n/*/checkpoints/000*"))

    check_said(kill_one(tmp_path, begun, killed, "train-policy", **settings), f"{who} (exit code -9)")
    for run in (tmp_path / "runs" / "n").iterdir():
        check_kept(run)
    check_resumed(whole_pair, tmp_path, "train-policy", **PAIR)
