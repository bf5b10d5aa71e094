"""A disk that fills up: what is whole stays, and the work goes on when there is room again."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import rerun as rr
import rerun.blueprint as rrb
from click.testing import CliRunner, Result

from pipeline.cli import cli
from rerun_blueprints.whole_file import recorded
from tests.pipeline.tiny_pipeline import (
    ARTIFACTS,
    PAIR,
    check_ended,
    check_kept,
    check_resumed,
    pipeline,
    remount,
    size,
    small_disk,
)
from tests.replay.tiny_run import CELL as RUN_CELL
from tests.replay.tiny_run import RUN_NAME, make_dataset, make_run

TINY = {
    **{"policy.schemes": '["oracle"]', "policy.episodes": "14", "policy.warmup_episodes": "1"},
    **{"policy.eval_every": "100", "policy.final_episodes": "1", "policy.checkpoint_every": "2"},
    **{"world.horizon": "60", "policy.td3.hidden": "[8]", "policy.td3.batch_size": "8"},
    **{"policy.processes": "1", "policy.workers": "0"},
}
CELL = "runs/n/reach-oracle-orbit00-seed0"
NO_ROOM = r"Error: cannot write /\S+/x: .*No space left on device; free space, or name another place with -o\n"


def train(data: Path, *more: str) -> Result:
    settings = [part for key, value in TINY.items() for part in ("--set", f"{key}={value}")]
    return CliRunner().invoke(cli, ["train-policy", "--name", "n", "--data", str(data), *settings, *more])


@pytest.mark.usefixtures("endless")
def test_a_run_goes_on_when_there_is_room_again(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 256 * 1024) as disk:
        full = train(disk)
        assert full.exit_code == 4 and "the disk is full" in full.stderr and "--resume" in full.stderr
        assert full.stderr.count("\n") == 1
        run = disk / CELL
        kept = pq.read_table(run / "episodes.parquet").num_rows
        parts = sorted((run / "transitions").iterdir())
        assert 2 <= kept < 14 and sum(pq.read_metadata(part).num_rows for part in parts) >= 60 * kept
        assert not list(run.rglob(".*.tmp")), "half a file would take the room"
        remount(disk, "size=64m")
        assert train(disk, "--resume").exit_code == 0
        assert train(tmp_path / "whole").exit_code == 0
        for name in ("transitions/part-00000.parquet", "evaluations.parquet", "checkpoints/policy.safetensors"):
            assert (run / name).read_bytes() == (tmp_path / "whole" / CELL / name).read_bytes(), name


@pytest.mark.usefixtures("endless")
def test_parts_in_processes_of_their_own(whole_pair: Path, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", size(whole_pair)) as disk:  # without room for two parts at a time
        full = pipeline("train-policy", disk, **PAIR)
        check_ended(full, "the disk is full", "free space, then --resume")
        for run in (disk / "runs" / "n").iterdir():
            check_kept(run)
        remount(disk, "size=64m")
        check_resumed(whole_pair, disk, "train-policy", **PAIR)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.usefixtures("endless")
def test_collecting(whole: Path, tmp_path: Path, workers: int) -> None:
    with small_disk(tmp_path / "disk", size(whole / "datasets") // 2) as disk:
        check_ended(pipeline("collect", disk, collect__workers=workers), "the disk is full", "then --resume")
        dataset = disk / ARTIFACTS["collect"]
        kept = {path.name: path.stat().st_mtime_ns for path in dataset.glob("episodes/*")}
        assert 1 <= len(kept) < 12
        check_kept(dataset)
        remount(disk, "size=64m")
        check_resumed(whole, disk, "collect")
        made = {path.name: path for path in dataset.glob("episodes/*")}
        assert {name: made[name].stat().st_mtime_ns for name in kept} == kept, "whole episodes are not made again"
        for name, path in made.items():
            assert path.read_bytes() == (whole / ARTIFACTS["collect"] / "episodes" / name).read_bytes()


@pytest.mark.parametrize(("checkpoints", "where"), [(1.5, "epoch-000002-"), (2.02, "estimator.safetensors")])
@pytest.mark.usefixtures("endless")
def test_training_an_estimator(whole: Path, tmp_path: Path, checkpoints: float, where: str) -> None:
    """While the second of two checkpoints is written, and when the estimator is."""
    weights = (whole / ARTIFACTS["train-perception"] / "estimator.safetensors").stat().st_size
    room = size(whole / "datasets") + int(checkpoints * 4 * weights) + 65536  # with the best weights and two moments
    with small_disk(tmp_path / "disk", room) as disk:
        shutil.copytree(whole / "datasets", disk / "datasets")
        check_ended(pipeline("train-perception", disk), "the disk is full", where, "free space, then --resume")
        estimator = disk / ARTIFACTS["train-perception"]
        check_kept(estimator)
        assert pq.read_table(estimator / "epochs.parquet").num_rows == 4
        assert list((estimator / "checkpoints").glob("epoch-000001-*.safetensors"))
        remount(disk, "size=64m")
        check_resumed(whole, disk, "train-perception")
        ours, theirs = (root / ARTIFACTS["train-perception"] / "estimator.safetensors" for root in (disk, whole))
        assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.parametrize("room", [40_000, 400_000])
def test_a_report(whole: Path, tmp_path: Path, room: int) -> None:
    with small_disk(tmp_path / "disk", size(whole) + room) as disk:
        shutil.copytree(whole, disk, dirs_exist_ok=True)
        full = pipeline("analyze", disk)
        assert full.exit_code == 4 and full.stderr.count("Error: ") == 1, full.output
        assert "unexpected" not in full.stderr and "again" in full.stderr, full.stderr
        assert list((disk / "reports").iterdir()) == []
        remount(disk, "size=64m")
        made = pipeline("analyze", disk)
        assert made.exit_code == 0, made.output


def test_a_recording(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (100, 100, 3), dtype=np.uint8)  # 30 kB
    with small_disk(tmp_path / "disk", 32 * 1024) as disk:
        recording = rr.RecordingStream("full")
        with pytest.raises(OSError, match="No space left"), recorded(recording, disk / "full.rrd", rrb.Blueprint()):
            for number in range(4):
                recording.set_time("step", sequence=number)
                recording.log("picture", rr.Image(noise))
        assert list(disk.iterdir()) == []


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run, and a dataset with images."""
    data = tmp_path_factory.mktemp("export") / "data"
    make_dataset(make_run(data), data / "datasets" / "tiny")
    return data


@pytest.mark.parametrize("form", ["minari", "robomimic", "lerobot"])
@pytest.mark.parametrize("artifact", [f"runs/{RUN_NAME}/{RUN_CELL}", "datasets/tiny"])
def test_an_export(exported: Path, tmp_path: Path, artifact: str, form: str) -> None:
    """Wherever it ends: at the first write, between two, and when the last of it leaves a buffer."""
    command = ["export", artifact, "--format", form, "--data", str(exported), "-o"]
    assert CliRunner().invoke(cli, [*command, str(tmp_path / "whole")]).exit_code == 0
    files = [path for path in (tmp_path / "whole", *(tmp_path / "whole").rglob("*")) if path.is_file()]
    needed = sum(path.stat().st_size for path in files)
    with small_disk(tmp_path / "disk", needed) as disk:
        for room in np.linspace(8192, needed - 8192, 8).astype(int).tolist():
            remount(disk, f"size={room}")
            full = CliRunner().invoke(cli, [*command, str(disk / "x")])
            assert full.exit_code == 4 and re.fullmatch(NO_ROOM, full.stderr), (room, full.output)
            assert list(disk.iterdir()) == [], room


@pytest.mark.parametrize("form", ["minari", "robomimic", "lerobot"])
def test_the_process_of_an_export_ends_well(exported: Path, tmp_path: Path, form: str) -> None:
    """HDF5 crashed it at its end."""
    with small_disk(tmp_path / "disk", 16 * 1024) as disk:
        command = [sys.executable, "-m", "pipeline", "export", "datasets/tiny", "--format", form, "-o", disk / "x"]
        full = subprocess.run([*command, "--data", exported], capture_output=True, text=True)
        assert full.returncode == 4 and re.fullmatch(NO_ROOM, full.stderr), full
        assert list(disk.iterdir()) == []
