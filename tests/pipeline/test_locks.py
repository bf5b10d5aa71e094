"""One writer per artifact, however it ends."""

import signal
import subprocess
import sys

import pytest

from pipeline.artifacts.lock import ArtifactLock, is_held
from pipeline.artifacts.store import Request, Store
from schemas.errors import ConfigError
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
