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
    found = soak._Watched()
    warm = [10.0 * look for look in range(20)] + [200.0] * 80
    assert found.growth(warm) == 0
    assert found.growth([*warm[:95], 900.0, *warm[96:]]) == 0
    assert found.growth([*warm[:90], *[206.0] * 10]) == pytest.approx(0.03)


def test_what_is_left_is_named(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak, "_PATIENCE", 0.1)
    shared = soak._shared_memory()
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    (root / "tmp" / "half").write_text("half")
    try:
        assert soak._left({psutil.Process(process.pid)}, shared, root) == [f"process {process.pid}", "temporary half"]
    finally:
        process.kill()
        process.wait()
    assert soak._left({psutil.Process()} & set(), shared, root) == [], "what was told of is put aside"


def test_a_command_is_watched_with_its_workers(root: Path) -> None:
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(2.5)'])"
    process = subprocess.Popen([sys.executable, "-c", child], stderr=subprocess.PIPE)
    found = soak._watch(process, root)
    assert len(found.seen) == 2 and found.seconds >= 2.5 and found.left == []
    assert all(memory > 1 for memory in found.memory) and all(handles >= 3 for handles in found.handles)
