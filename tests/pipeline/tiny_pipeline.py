"""The real stages, very small, on file systems that can be mounted for a test."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from benchmarks.crash_checks import different, unreadable
from pipeline.cli import cli

SETTINGS: dict[str, Any] = {
    **{"world.horizon": 15, "collect.episodes": 12, "collect.steps": 8, "collect.workers": 1},
    **{"perception.epochs": 2, "perception.batch_size": 8, "perception.test_misalignments": [5.0]},
    **{"policy.schemes": ["oracle"], "policy.episodes": 6, "policy.warmup_episodes": 1, "policy.eval_every": 100},
    **{"policy.final_episodes": 1, "policy.checkpoint_every": 2, "policy.td3.hidden": [8], "policy.td3.batch_size": 8},
    **{"policy.processes": 1, "policy.workers": 0, "policy.threads": 1, "analyze.bootstrap_samples": 100},
}
ARTIFACTS = {
    "collect": "datasets/n",
    "train-perception": "estimators/n",
    "train-policy": "runs/n/reach-oracle-orbit00-seed0",
}


PAIR = {"policy__seeds": [0, 1], "policy__episodes": 30, "policy__processes": 2}
"""Two runs that last a while, in processes of their own."""


def arguments(command: str, data: Path, *more: str, **settings: Any) -> list[str]:
    """Of the command line; `settings` have `__` for a dot."""
    chosen = SETTINGS | {key.replace("__", "."): value for key, value in settings.items()}
    options = [part for key, value in chosen.items() for part in ("--set", f"{key}={json.dumps(value)}")]
    return [command, "--name", "n", "--data", str(data), "--quiet", *options, *more]


def pipeline(command: str, data: Path, *more: str, **settings: Any) -> Result:
    """Run a stage in this process."""
    return CliRunner().invoke(cli, arguments(command, data, *more, **settings))


def check_ended(result: Result, *said: str) -> None:
    """Exit 4, and one message with the way out."""
    assert result.exit_code == 4, result.output
    assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1, result.stderr
    assert "unexpected" not in result.stderr
    for each in said:
        assert each in result.stderr


def check_kept(artifact: Path) -> None:
    """What is there can be read, and nothing half-written takes room."""
    assert unreadable(artifact) == []
    assert not list(artifact.rglob(".*.tmp"))


def check_resumed(whole: Path, data: Path, command: str, **settings: Any) -> None:
    """`--resume` ends as what was never interrupted, in `whole`."""
    resumed = pipeline(command, data, "--resume", **settings)
    assert resumed.exit_code == 0, resumed.output
    name = ARTIFACTS[command].split("/")[0]
    assert different(whole / name, data / name) == []


@contextmanager
def mounted(directory: Path, *options: str) -> Iterator[Path]:
    """A file system at `directory`; the test is skipped where none can be mounted."""
    directory.mkdir()
    try:
        subprocess.run(["mount", *options, str(directory)], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no file system can be mounted here")
    try:
        yield directory
    finally:
        subprocess.run(["umount", "--lazy", str(directory)], check=True)  # a failed test may still hold a file


def small_disk(directory: Path, size: int) -> Any:
    """One of `size` bytes."""
    return mounted(directory, "-t", "tmpfs", "-o", f"size={size}", "tmpfs")


def remount(directory: Path, options: str) -> None:
    """Change how it is mounted."""
    subprocess.run(["mount", "-o", f"remount,{options}", str(directory)], check=True, capture_output=True)


def size(directory: Path) -> int:
    """Bytes of its files, in whole pages as tmpfs counts them."""
    return sum(-(-path.stat().st_size // 4096) * 4096 for path in directory.rglob("*") if path.is_file())
