"""A file system that cannot be written to, from the start or from midway on; and a permission that is lost."""

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pipeline.artifacts.lock import ArtifactLock
from pipeline.cli import cli
from stages.collect.collector import Collector
from stages.perception import training
from stages.policy.log import RunLog
from tests.pipeline.tiny_pipeline import (
    ARTIFACTS,
    check_ended,
    check_kept,
    check_resumed,
    mounted,
    pipeline,
    remount,
    small_disk,
)

MIDWAY: dict[str, tuple[Any, str]] = {
    "collect": (Collector, "collect"),
    "train-perception": (training, "save_checkpoint"),
    "train-policy": (RunLog, "flush"),
}
"""What each stage does after a whole piece of work."""


@pytest.fixture
def read_only(whole: Path, tmp_path: Path) -> Iterator[Path]:
    """The whole data root and an interrupted run, on a file system mounted read-only."""
    with small_disk(tmp_path / "disk", 64 << 20) as disk:
        shutil.copytree(whole, disk, dirs_exist_ok=True)
        interrupted = disk / "runs" / "stopped" / "reach-oracle-orbit00-seed0"
        shutil.copytree(disk / ARTIFACTS["train-policy"], interrupted)
        manifest = json.loads((interrupted / "manifest.json").read_text())
        manifest |= {"id": f"runs/stopped/{interrupted.name}", "status": "running", "files": []}
        (interrupted / "manifest.json").write_text(json.dumps(manifest))
        ArtifactLock(disk, manifest["id"]).acquire()  # released when it is collected
        remount(disk, "ro")
        yield disk


@pytest.mark.parametrize("command", [*ARTIFACTS, "analyze"])
@pytest.mark.usefixtures("endless")
def test_nothing_is_begun(read_only: Path, command: str) -> None:
    if command in ARTIFACTS:  # a report needs all of them
        remount(read_only, "rw")
        shutil.rmtree(read_only / ARTIFACTS[command])
        remount(read_only, "ro")
    check_ended(pipeline(command, read_only), "the file system is read-only (", "--data")


def test_reading(read_only: Path, tmp_path: Path) -> None:
    def ask(*arguments: object) -> str:
        done = CliRunner().invoke(cli, [*map(str, arguments), "--data", str(read_only)])
        assert done.exit_code == 0, done.output
        return done.stdout

    listed = {each["id"]: each for each in json.loads(ask("list", "--json"))["artifacts"]}
    stopped = listed["runs/stopped/reach-oracle-orbit00-seed0"]
    assert (stopped["status"], stopped["being_written"]) == ("running", False)
    assert "datasets/n" in ask("show", "estimators/n")
    assert json.loads(ask("sql", "SELECT count(*) AS n FROM frames", "--json"))["rows"]
    ask("verify", "datasets/n")
    ask("view", "datasets/n", "--save", tmp_path / "n.rrd")
    assert (tmp_path / "n.rrd").stat().st_size > 1000


@contextmanager
def journalled(tmp_path: Path) -> Iterator[tuple[Path, Path]]:
    """A file system that can fail under open files: (directory, image)."""
    image = tmp_path / "image"
    image.touch()
    try:
        subprocess.run(["truncate", "-s", "64M", image], check=True, capture_output=True)
        subprocess.run(["mkfs.ext4", "-q", image], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no ext4 can be made here")
    with mounted(tmp_path / "disk", "-o", "loop,errors=remount-ro", str(image)) as disk:
        yield disk, image


def mend(disk: Path, image: Path) -> None:
    subprocess.run(["umount", str(disk)], check=True)
    assert subprocess.run(["e2fsck", "-fy", str(image)], capture_output=True).returncode < 4
    subprocess.run(["mount", "-o", "loop", str(image), str(disk)], check=True)


def after(calls: int, patch: pytest.MonkeyPatch, command: str, happens: Callable[[], None]) -> None:
    """What `happens` when a stage has done so many pieces of its work."""
    owner, name = MIDWAY[command]
    original, made = getattr(owner, name), []

    def call(*given: Any) -> Any:
        result = original(*given)
        made.append(1)
        if len(made) == calls:
            happens()
        return result

    patch.setattr(owner, name, call)


@pytest.mark.parametrize("command", MIDWAY)
@pytest.mark.usefixtures("endless")
def test_a_disk_that_fails_midway(whole: Path, tmp_path: Path, command: str) -> None:
    """The kernel makes it read-only under open files; what was not yet on disk is gone, as after a power cut."""
    with journalled(tmp_path) as (disk, image):
        if command != "collect":
            shutil.copytree(whole / "datasets", disk / "datasets")
        subprocess.run(["sync"], check=True)
        with pytest.MonkeyPatch.context() as patch:
            after(1, patch, command, lambda: remount(disk, "abort"))
            check_ended(pipeline(command, disk), "the file system is read-only (", "--resume")
        mend(disk, image)
        check_resumed(whole, disk, command)


@pytest.mark.parametrize("command", MIDWAY)
@pytest.mark.usefixtures("endless")
def test_permission_lost_midway(whole: Path, tmp_path: Path, command: str) -> None:
    """Whoever runs the tests may be allowed everything: files that are opened to be written refuse it."""
    if command != "collect":
        shutil.copytree(whole / "datasets", tmp_path / "datasets")
    with pytest.MonkeyPatch.context() as patch:

        def lose() -> None:
            def refuse(path: Path, mode: str = "r", *given: Any, **options: Any) -> Any:
                if "w" in mode:
                    raise PermissionError(13, "Permission denied", str(path))
                return original(path, mode, *given, **options)

            original = Path.open
            patch.setattr(Path, "open", refuse)

        after(1, patch, command, lose)
        check_ended(pipeline(command, tmp_path), "permission denied (", "then --resume")
    check_kept(tmp_path / ARTIFACTS[command])
    check_resumed(whole, tmp_path, command)
