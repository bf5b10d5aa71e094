"""A disk that fills up while a run trains: whole episodes stay, and it goes on when there is room again."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from pipeline.cli import cli

TINY = {
    **{"policy.schemes": '["oracle"]', "policy.episodes": "14", "policy.warmup_episodes": "1"},
    **{"policy.eval_every": "100", "policy.final_episodes": "1", "policy.checkpoint_every": "2"},
    **{"world.horizon": "60", "policy.td3.hidden": "[8]", "policy.td3.batch_size": "8"},
    **{"policy.processes": "1", "policy.workers": "0"},
}
CELL = "runs/n/reach-oracle-orbit00-seed0"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A filesystem of 256 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no filesystem can be mounted here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def train(data: Path, *more: str) -> Result:
    settings = [part for key, value in TINY.items() for part in ("--set", f"{key}={value}")]
    return CliRunner().invoke(cli, ["train-policy", "--name", "n", "--data", str(data), *settings, *more])


def test_a_run_goes_on_when_there_is_room_again(
    small_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.steps.policy.require_space", lambda directory, needed: None)
    full = train(small_disk)
    assert full.exit_code == 4 and "the disk is full" in full.stderr and "--resume" in full.stderr
    assert full.stderr.count("\n") == 1
    run = small_disk / CELL
    kept = pq.read_table(run / "episodes.parquet").num_rows
    parts = sorted((run / "transitions").iterdir())
    assert 2 <= kept < 14 and sum(pq.read_metadata(part).num_rows for part in parts) >= 60 * kept
    assert not list(run.rglob(".*.tmp")), "half a file would take the room"
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    assert train(small_disk, "--resume").exit_code == 0
    assert train(tmp_path / "whole").exit_code == 0
    for name in ("transitions/part-00000.parquet", "evaluations.parquet", "checkpoints/policy.safetensors"):
        assert (run / name).read_bytes() == (tmp_path / "whole" / CELL / name).read_bytes(), name
