"""Readers of a run that is being trained: they work at any moment, and see whole episodes only."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.pipeline.fakes import Run, answer
from tests.pipeline.tiny_pipeline import ARTIFACTS, SETTINGS, arguments

RUN, STEPS = ARTIFACTS["train-policy"], SETTINGS["world.horizon"]
EPISODES = f"""
    SELECT count(*) AS episodes, max(episode) AS newest,
           count(*) FILTER (steps <> {STEPS} OR last <> {STEPS - 1}) AS broken
    FROM (SELECT episode, count(*) AS steps, max(step) AS last FROM transitions WHERE split = 'train' GROUP BY ALL)
"""
TOLD = """
    SELECT count(*) AS told FROM episodes AS e
    WHERE NOT EXISTS (FROM transitions AS t WHERE t.split = e.split AND t.episode = e.episode)
"""


def asked(run: Run, sql: str) -> dict[str, int]:
    result = run("sql", sql, "--format", "json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)[0]


def wait_for(process: subprocess.Popen[bytes], begun: Callable[[], bool]) -> None:
    until = time.monotonic() + 120
    while not begun():
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.02)


def newest_checkpoint(run: Path) -> str:
    return max((path.name for path in run.glob("checkpoints/0*")), default="")


def test_at_any_moment(run: Run, data: Path, tmp_path: Path) -> None:
    command = arguments("train-policy", data, policy__episodes=120, policy__checkpoint_every=1)
    training = subprocess.Popen([sys.executable, "-m", "pipeline", *command])
    try:
        seen: list[int] = []
        reports: list[str] = []
        wait_for(training, (data / RUN / "manifest.json").exists)
        while training.poll() is None:
            found = asked(run, EPISODES)
            assert found["broken"] == 0 and found["newest"] in (None, found["episodes"] - 1)
            assert asked(run, TOLD)["told"] == 0
            seen.append(found["episodes"])
            for reader in (("list",), ("verify",)):
                assert run(*reader).exit_code == 0
            if found["episodes"] > 2 and not (tmp_path / "a.rrd").exists():
                viewed = run("view", RUN, "--split", "train", "--episode", "1", "--save", tmp_path / "a.rrd")
                assert viewed.exit_code == 0, viewed.output
            if len(reports) < 3:
                made = answer(run("analyze", "--runs", RUN, "--set", "analyze.bootstrap_samples=100", "--json"))
                reports.append((Path(made["path"]) / "report.html").read_text())
    finally:
        training.kill()
    assert training.returncode == 0
    assert seen == sorted(seen) and len(set(seen)) > 3, "it was looked at while it grew"
    assert asked(run, EPISODES)["episodes"] == 120
    assert len(reports) == 3 and all("1 run still training: the numbers are as of now" in page for page in reports)


def test_a_second_writer_is_told_who_the_first_is(run: Run, data: Path) -> None:
    """Also the one that would resume; once the first is killed its lock is stale, and nobody is refused."""
    command = arguments("train-policy", data, policy__episodes=100_000)
    first = subprocess.Popen([sys.executable, "-m", "pipeline", *command])
    try:
        wait_for(first, lambda: newest_checkpoint(data / RUN) > "000010")
        second = subprocess.run(
            [sys.executable, "-m", "pipeline", *command, "--resume"], capture_output=True, text=True, timeout=60
        )
    finally:
        first.kill()
        first.wait()
    assert second.returncode == 2 and f"is being written by another process (pid {first.pid})" in second.stderr
    reached = newest_checkpoint(data / RUN)
    third = subprocess.Popen([sys.executable, "-m", "pipeline", *command, "--resume"])
    try:
        wait_for(third, lambda: newest_checkpoint(data / RUN) > reached)
    finally:
        third.kill()
        third.wait()
