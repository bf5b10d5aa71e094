"""Collecting: resumable, the same with any number of workers, clear when it cannot go on."""

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from schemas import mcap_files
from schemas.errors import DivergedError, MachineError
from schemas.mcap_files import read_metadata
from stages.collect import collector
from stages.collect.recorder import config_sha256
from stages.sim.world import World
from tests.collect.small_dataset import decode, episode_files, frames, tiny

Collect = Callable[..., dict[str, Any]]


class Still:
    """An actor that does not move."""

    def act(self, state: np.void, task: str) -> np.ndarray:
        return np.zeros(8 if task == "lift" else 7, np.float32)


def unstable_process() -> Still:
    """An actor in whose worker process every simulation becomes unstable."""
    step = World.step

    def unstable(self: World, action: np.ndarray) -> np.void:
        state = step(self, action)
        state["unstable"] = True
        return state

    World.step = unstable  # type: ignore[method-assign]
    return Still()


class Overflown(Still):
    """An actor whose numbers became too large."""

    def act(self, state: np.void, task: str) -> np.ndarray:
        return super().act(state, task) * np.nan


class Deadly:
    """An actor whose process is killed, as the kernel does when memory runs out."""

    def act(self, state: np.void, task: str) -> np.ndarray:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("not reached")


def contents(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in episode_files(out)}


def test_summary_counts(collect: Collect, tmp_path: Path) -> None:
    summary = collect(tiny())
    assert summary.pop("wall_time_s") > 0
    assert summary == {
        "episodes": 3,
        "frames": 12,
        "bytes": sum(path.stat().st_size for path in episode_files(tmp_path / "out")),
        "behaviours": {"random": 1, "scripted": 2},
        "success_rate": summary["success_rate"],
    }
    assert sum(key.startswith("scripted") for key in summary["success_rate"]) >= 1


def test_dataset_does_not_depend_on_workers(collect: Collect, tmp_path: Path) -> None:
    collect(tiny())
    alone = contents(tmp_path / "out")
    table = pq.read_table(tmp_path / "out" / "frames.parquet")
    (tmp_path / "out").rename(tmp_path / "alone")
    collect(tiny(workers=2))
    assert contents(tmp_path / "out") == alone
    assert pq.read_table(tmp_path / "out" / "frames.parquet").equals(table)


def test_resuming_makes_only_what_is_missing_or_damaged(collect: Collect, tmp_path: Path) -> None:
    collect(tiny())
    out, whole = tmp_path / "out", contents(tmp_path / "out")
    kept, damaged, missing = episode_files(out)
    untouched = kept.stat().st_mtime_ns
    damaged.write_bytes(damaged.read_bytes()[:-100])
    missing.rename(missing.with_name(f".{missing.name}.tmp"))  # as a killed process leaves it
    (out / "frames.parquet").unlink()
    assert collect(tiny())["frames"] == 12
    assert contents(out) == whole
    assert kept.stat().st_mtime_ns == untouched
    assert pq.read_table(out / "frames.parquet").num_rows == 12


def test_files_of_another_configuration_are_not_taken_over(collect: Collect, tmp_path: Path) -> None:
    collect(tiny())
    collect(tiny(seed=1))
    expected = config_sha256(tiny(seed=1))
    assert {read_metadata(path)["config_sha256"] for path in episode_files(tmp_path / "out")} == {expected}


def test_files_of_another_episode_are_not_taken_over(collect: Collect, tmp_path: Path) -> None:
    """Every step is kept, so that episodes that changed places lack no frames."""
    config = tiny(keep_fraction=1.0)
    collect(config)
    out, whole = tmp_path / "out", contents(tmp_path / "out")
    table = pq.read_table(out / "frames.parquet")
    first, second, third = episode_files(out)
    first.write_bytes(whole[second.name])
    second.write_bytes(whole[first.name])
    third.write_bytes(whole[first.name])
    collect(config)
    assert contents(out) == whole
    assert pq.read_table(out / "frames.parquet").equals(table)


def test_config_hash_ignores_only_the_workers() -> None:
    assert config_sha256(tiny()) == config_sha256(tiny(workers=7))
    assert config_sha256(tiny()) != config_sha256(tiny(action_noise=0.3))


def test_jpeg_and_lz4(collect: Collect, tmp_path: Path) -> None:
    collect(tiny(image_format="jpeg", compression="lz4", episodes=1))
    message = frames(episode_files(tmp_path / "out")[0])[0]["/camera/image"]
    assert message.format == "jpeg"
    assert message.data[:3] == b"\xff\xd8\xff"
    assert decode(message).shape == (32, 32, 3)


def test_an_injected_actor_acts(collect: Collect, tmp_path: Path) -> None:
    summary = collect(tiny(random_fraction=0.0, action_noise=0.0), actor=Still)
    assert summary["behaviours"] == {"policy": 3}
    actions = mcap_files.read_messages(episode_files(tmp_path / "out")[0], "/action")
    assert {value for _, _, message in actions for value in message.values} == {0.0}


def test_killed_worker_is_a_machine_error(collect: Collect) -> None:
    with pytest.raises(MachineError, match="a collect worker died"):
        collect(tiny(workers=2, random_fraction=0.0), actor=Deadly)


def test_unstable_simulation_names_the_episode(
    collect: Collect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample = collector.sample_initial_state

    def diverging_in_lift(scene: Any, task: str, *rest: Any) -> np.ndarray:
        state = sample(scene, task, *rest)
        return np.full_like(state, np.nan) if task == "lift" else state

    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings to a file in the working directory
    monkeypatch.setattr(collector, "sample_initial_state", diverging_in_lift)
    with pytest.raises(DivergedError, match=r"episode 1 \(lift, .*unstable at step 0"):
        collect(tiny())
    assert [path.name for path in (tmp_path / "out" / "episodes").iterdir()] == ["episode-000000.mcap"]


def test_what_led_to_an_unstable_simulation_is_kept(
    collect: Collect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulated again from there it is the episode that it would have been; the next try starts without it."""
    step = World.step

    def breaking(self: World, action: np.ndarray) -> np.void:
        state = step(self, action)
        state["unstable"] |= self.task == "lift" and state["time_ns"] == 150_000_000
        return state

    with monkeypatch.context() as patch:
        patch.setattr(World, "step", breaking)
        with pytest.raises(DivergedError, match=r"unstable at step 2; .* kept in .*failure/episode-000001\.parquet"):
            collect(tiny())
    [kept] = (tmp_path / "out" / "failure").iterdir()
    rows = pq.read_table(kept).to_pylist()
    assert [(row["episode"], row["task"], row["seed"], row["step"]) for row in rows] == [
        (1, "lift", tiny().collect.seed, step) for step in range(3)
    ]
    collect(tiny())
    assert not kept.parent.exists()
    made = list(mcap_files.read_messages(episode_files(tmp_path / "out")[1], "/action"))[:3]
    assert [row["action"] for row in rows] == [list(message.values) for _, _, message in made]
    assert [row["initial_state"] for row in rows[1:]] == [None, None]
    states = mcap_files.read_messages(episode_files(tmp_path / "out")[1], "/sim/state")
    assert rows[0]["initial_state"] == list(next(states)[2].integration_state)


def test_an_unstable_simulation_in_another_process(collect: Collect, tmp_path: Path) -> None:
    with pytest.raises(DivergedError, match="the simulation became unstable at step 0"):
        collect(tiny(workers=2, random_fraction=0.0), actor=unstable_process)
    assert list((tmp_path / "out" / "failure").glob("episode-*.parquet"))


def test_a_policy_whose_action_is_no_number(collect: Collect, tmp_path: Path) -> None:
    """Finite weights may overflow."""
    with pytest.raises(
        DivergedError, match=r"episode 0 \(.*, policy\): the action is not a number at step 0; .*policy"
    ):
        collect(tiny(random_fraction=0.0), actor=Overflown)
    assert list((tmp_path / "out" / "episodes").iterdir()) == []


def test_a_full_disk_keeps_no_halves(collect: Collect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(mcap_files, "Writer", full)
        with pytest.raises(OSError, match=r"No space left .*episode-000000\.mcap"):
            collect(tiny())
    assert list((tmp_path / "out" / "episodes").iterdir()) == []
    with monkeypatch.context() as patch:
        patch.setattr(mcap_files.os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            collect(tiny())
    assert collect(tiny())["frames"] == 12


def test_a_dataset_is_durable_when_collect_returns(
    collect: Collect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, fsync = set(), os.fsync

    def noting(descriptor: int) -> None:
        synced.add(os.fstat(descriptor).st_ino)
        fsync(descriptor)

    monkeypatch.setattr(mcap_files.os, "fsync", noting)
    collect(tiny())
    out = tmp_path / "out"
    everything = (*episode_files(out), out / "episodes", out / "frames.parquet", out)
    assert {path.stat().st_ino for path in everything} <= synced


INTERRUPTED = """
import sys
from pathlib import Path
from schemas.progress import Silent
from stages.collect.run import run
from tests.collect.small_dataset import tiny
if __name__ == "__main__":
    run(tiny(workers=2, episodes=400), Path(sys.argv[1]), dataset="d", progress=Silent())
"""


def started(command: list[object], **options: Any) -> subprocess.Popen[str]:
    """A process with a session of its own that hears Ctrl-C, also where the tests run in the background of a shell."""
    return subprocess.Popen(
        [str(part) for part in command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )


def test_interrupt_keeps_finished_episodes_and_leaves_no_half_ones(tmp_path: Path) -> None:
    script = tmp_path / "collect.py"
    script.write_text(INTERRUPTED)
    out = tmp_path / "out"
    out.mkdir()
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    process = started([sys.executable, script, out], env=environment)
    try:
        while process.poll() is None and not list(out.glob("episodes/*.mcap")):
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does on Ctrl-C
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert errors.count("Traceback") == 1
    assert errors.strip().endswith("KeyboardInterrupt")
    files = list((out / "episodes").iterdir())
    assert 0 < len(files) < 400
    assert all(path.name.startswith("episode-") for path in files)
    assert all(len(frames(path)) == 4 for path in files)


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    """Worker processes started so far, be they still importing."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers in /proc")
def test_interrupt_while_the_workers_start(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pipeline", "collect", "--data", tmp_path, "--set", "collect.workers=2"]
    process = started(command, cwd=Path(__file__).parents[2])
    try:
        while process.poll() is None and len(workers_of(process)) < 2:
            time.sleep(0.01)
        time.sleep(0.2)  # they are importing
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    said = [line.split(" ")[0] for line in errors.splitlines() if line]
    assert said == ["stopping", "Error:"], "no worker says anything"


@pytest.mark.parametrize("workers", [1, 2])
def test_twice_interrupted_it_ends_in_the_middle_of_an_episode(tmp_path: Path, workers: int) -> None:
    settings = ("collect.steps=3_000", "collect.episodes=4", f"collect.workers={workers}")
    options = [part for each in settings for part in ("--set", each)]
    command = [sys.executable, "-m", "pipeline", "collect", "--data", tmp_path, *options]
    process = started(command, cwd=Path(__file__).parents[2])
    try:
        while process.poll() is None and not list(tmp_path.glob("datasets/*/episodes/.*")):
            time.sleep(0.05)
        for _ in range(2):
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.5)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert list(tmp_path.glob("datasets/*/episodes/*")) == []


def test_collecting_does_not_load_torch() -> None:
    code = "import sys, stages.collect.run, stages.collect.rerender; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])
