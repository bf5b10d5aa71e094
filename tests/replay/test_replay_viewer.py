"""The viewer opens for this machine alone, or says why it does not."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from schemas.errors import MachineError
from stages.replay import viewer


class Started:
    """Stands for a process: `returncode` None means that it goes on."""

    def __init__(self, returncode: int | None) -> None:
        self.returncode = returncode

    def wait(self, timeout: float) -> int:
        if self.returncode is None:
            raise subprocess.TimeoutExpired("viewer", timeout)
        return self.returncode


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands that would have been started, with a display."""
    monkeypatch.setenv("DISPLAY", ":0")
    started: list[list[str]] = []

    def popen(command: list[str], **_: Any) -> Started:
        started.append(command)
        return Started(None)

    monkeypatch.setattr(subprocess, "Popen", popen)
    return started


def test_the_viewers_server_listens_on_this_machine_only(commands: list[list[str]]):
    viewer.open_viewer(Path("episode.rrd"))
    (command,) = commands
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == "episode.rrd"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have a display or fail in the viewer")
def test_without_a_display_the_message_names_save(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(MachineError, match="no display.*--save FILE.rrd"):
        viewer.open_viewer(Path("episode.rrd"))


def test_a_viewer_that_ends_at_once_is_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: Started(1))
    with pytest.raises(MachineError, match="ended with code 1"):
        viewer.open_viewer(Path("episode.rrd"))


def test_free_ports_can_be_bound():
    assert 1024 <= viewer.free_port() <= 65535
