"""The soak sees what grows, and what is left."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from benchmarks import soak


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "tmp").mkdir()
    return tmp_path


def test_growth_is_from_warm_to_the_end() -> None:
    """The start does not count; one look that is out of line does not either."""
    found = soak._Watched(rows=[200_000, 199_000])
    assert found.warm == 3, "a part of 40,000 rows is whole after 0.201 of it"
    warm = [10.0 * look for look in range(30)] + [300.0] * 70
    assert found.growth(warm) == 0
    assert found.growth([*warm[:95], 900.0, *warm[96:]]) == 0
    assert found.growth([*warm[:90], *[309.0] * 10]) == pytest.approx(0.03)
    assert soak._Watched(rows=[1_000]).warm == 2, "no part is ever whole"


HOLD = """
import multiprocessing, time
lock = multiprocessing.get_context("spawn").Lock()
print("held", flush=True)
time.sleep(60)
"""


def test_what_is_left_is_named(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process, its semaphore and a temporary file; once they are gone, or told of, nothing."""
    monkeypatch.setattr(soak, "_PATIENCE", 0.1)
    process = subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline()
    (root / "tmp" / "half").write_text("half")
    found = soak._Watched()
    try:
        soak._look(found, psutil.Process(process.pid))
        left = soak._left(found, root)
        assert f"process {process.pid}" in left and "temporary half" in left
        assert [name for name in left if name.startswith("shared memory sem.")]
    finally:
        process.terminate()
        process.wait()
    monkeypatch.setattr(soak, "_PATIENCE", 10.0)
    assert soak._left(found, root) == []


def test_a_command_is_watched_with_its_workers(root: Path) -> None:
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(2.5)'])"
    process = subprocess.Popen([sys.executable, "-c", child], stderr=subprocess.PIPE)
    found = soak._watch(process, root)
    assert len(found.seen) == 2 and found.seconds >= 2.5 and found.left == []
    assert max(found.memory) > 5 and max(found.handles) >= 6, "of both"
