"""One writer per artifact, however it ends."""

import fcntl
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pipeline.artifacts.lock import ArtifactLock, is_held
from pipeline.artifacts.store import Request, Store
from schemas.errors import ArtifactError, ConfigError
from tests.pipeline.fakes import begin

ASKED = Request("datasets/small", {"collect": {"episodes": 1}})


HOLD = """
import sys, time
from pathlib import Path
from pipeline.artifacts.store import Request, Store
with Store(Path(sys.argv[1])).begin(Request("datasets/small", {"collect": {"episodes": 1}}), resume=True) as build:
    (build.path / "half").write_text("half")
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(store: Store) -> subprocess.Popen[str]:
    """Another process that is writing the dataset."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(store.root)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()


def test_two_processes_do_not_write_one_artifact(store: Store, holder: subprocess.Popen[str]) -> None:
    for _ in range(2):  # the first refusal must not let the second through
        with pytest.raises(ConfigError, match=rf"being written by another process \(pid {holder.pid}\)"):
            store.begin(ASKED, resume=True)
    assert is_held(store.root, ASKED.id)


def test_the_lock_of_a_killed_process_is_free(store: Store, holder: subprocess.Popen[str]) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert not is_held(store.root, ASKED.id)
    with begin(store, ASKED, resume=True) as build:
        assert (build.path / "half").read_text() == "half"
        build.finish({})


def test_locks_of_different_artifacts_are_independent(store: Store) -> None:
    first, second = (ArtifactLock(store.root, f"runs/a/{cell}") for cell in "xy")
    first.acquire()
    second.acquire()
    assert is_held(store.root, "runs/a/x")
    first.release()
    assert not is_held(store.root, "runs/a/x")
    assert is_held(store.root, "runs/a/y")
    second.release()


def test_a_reader_that_asks_keeps_no_writer_out(store: Store) -> None:
    """It holds the lock for the moment of its question."""
    path = ArtifactLock(store.root, ASKED.id).path
    path.parent.mkdir(parents=True)
    with path.open("w") as asking:
        fcntl.flock(asking, fcntl.LOCK_SH)
        threading.Timer(0.1, lambda: fcntl.flock(asking, fcntl.LOCK_UN)).start()
        with begin(store, ASKED) as build:
            build.finish({})


def test_locks_are_not_written_elsewhere(store: Store, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    store.root.mkdir(parents=True)
    (store.root / ".locks").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ArtifactError, match="leads out of the data root"):
        store.begin(ASKED, resume=False)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_link_in_an_artifact_is_not_written_through(store: Store, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(ZeroDivisionError), begin(store, ASKED) as build:
        (build.path / "half").write_text("half")
        (build.path / "episodes").symlink_to(tmp_path / "elsewhere")
        raise ZeroDivisionError
    with pytest.raises(ArtifactError, match=r"episodes is a link that leads out of the artifact"):
        store.begin(ASKED, resume=True)
