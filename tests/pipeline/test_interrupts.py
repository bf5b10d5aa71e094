"""Ctrl-C once keeps the episode, twice stops now; SIGTERM is as once."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline import interrupts

ENDING = """
import atexit, sys, time
from pipeline.cli import main
atexit.register(lambda: (print("ending", flush=True), time.sleep(1)))
sys.argv = ["pipeline", "--version"]
main()
"""

TINY = {
    **{"policy.schemes": '["oracle"]', "policy.episodes": "6", "policy.warmup_episodes": "1"},
    **{"policy.eval_every": "100", "policy.final_episodes": "1", "policy.checkpoint_every": "100"},
    **{"world.horizon": "100", "policy.td3.hidden": "[32]", "policy.td3.batch_size": "16", "policy.processes": "1"},
}


@pytest.fixture
def handlers(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """This process's own handlers and a wish of its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(interrupts, "_wish", interrupts._Wish())
    interrupts.install()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("handlers")
def test_outside_of_resumable_work_it_ends_at_once(number: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert not interrupts.requested()


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("handlers")
def test_once_asks_and_the_second_ctrl_c_ends(first: signal.Signals, capfd: pytest.CaptureFixture[str]) -> None:
    with interrupts.finishing():
        signal.raise_signal(first)
        signal.raise_signal(signal.SIGTERM)  # a supervisor that repeats itself is not impatient
        assert interrupts.requested()
        assert capfd.readouterr().err.count("Ctrl-C again: now") == 1
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("handlers")
def test_what_ended_anyway_is_kept_and_nothing_else_is_begun() -> None:
    with interrupts.finishing():
        signal.raise_signal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), interrupts.finishing():
        pytest.fail("the next stage was begun")


def test_an_impatient_ctrl_c_does_not_change_how_it_ends() -> None:
    """The command is over, and the interpreter is tidying up."""
    process = subprocess.Popen(
        [sys.executable, "-c", ENDING], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    while "ending" not in process.stdout.readline():
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (0, "")


def start(data: Path, *more: str) -> subprocess.Popen[str]:
    settings = [part for key, value in TINY.items() for part in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "pipeline", "train-policy", "--name", "n", "--data", str(data), *settings, *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_stopped_run_goes_on_and_ends_as_if_it_had_not_been(tmp_path: Path) -> None:
    stopped = start(tmp_path / "stopped")
    cell = "runs/n/reach-oracle-orbit00-seed0"
    log = tmp_path / "stopped" / cell / "transitions"
    while not log.is_dir() and stopped.poll() is None:
        time.sleep(0.05)
    os.kill(stopped.pid, signal.SIGINT)
    _, said = stopped.communicate(timeout=120)
    assert stopped.returncode == 130, said
    assert "stopping at the next whole episode" in said and "--resume goes on from the last checkpoint" in said
    kept = pq.read_table(tmp_path / "stopped" / cell / "episodes.parquet").num_rows
    assert 1 <= kept < 6, "the episode was finished and kept, though no checkpoint was due"
    for root, more in (("stopped", "--resume"), ("whole", "--quiet")):
        process = start(tmp_path / root, more)
        assert process.wait(timeout=120) == 0
    one, other = (tmp_path / root / cell for root in ("stopped", "whole"))
    for name in ("transitions/part-00000.parquet", "evaluations.parquet", "checkpoints/policy.safetensors"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def test_a_supervisor_s_sigterm_to_all_processes_is_one_wish(tmp_path: Path) -> None:
    """Also to those that simulate: the episode is finished and kept."""
    cell = tmp_path / "runs/n/reach-oracle-orbit00-seed0"
    settings = [sys.executable, "-m", "pipeline", "train-policy", "--name", "n", "--data", str(tmp_path)]
    settings += [part for key, value in TINY.items() for part in ("--set", f"{key}={value}")]
    process = subprocess.Popen(
        [*settings, "--set", "policy.workers=1"], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while not (cell / "transitions").is_dir() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGTERM)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130, said
    assert pq.read_table(cell / "episodes.parquet").num_rows >= 1
