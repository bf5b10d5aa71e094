"""Opens the Rerun viewer for this machine only: its server listens on 127.0.0.1, by default on every interface."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from schemas.cache import cache_directory
from schemas.errors import MachineError
from schemas.files import write_bytes

LOOPBACK = "127.0.0.1"
_FAILS_WITHIN = 2.0  # [s]; a viewer that has no window to open ends at once


def require_display() -> None:
    """Pass if there is a screen: asked before the work of making what would be shown.

    Raises:
        MachineError: there is none.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MachineError("no display to open the viewer on: use --save FILE.rrd and open the file elsewhere")


def open_viewer(recording: Path) -> subprocess.Popen[bytes]:
    """Show a recording (.rrd or .mcap) in a window; its process. It reads the file whenever it comes to it.

    Raises:
        MachineError: there is no screen, or the viewer does not start.
    """
    require_display()
    process = start_viewer(recording, "--port", str(free_port()))
    try:
        process.wait(_FAILS_WITHIN)
    except subprocess.TimeoutExpired:
        return process
    if process.returncode:
        raise MachineError(f"the Rerun viewer ended with code {process.returncode}; use --save FILE.rrd instead")
    return process


def start_viewer(recording: Path, *options: str) -> subprocess.Popen[bytes]:
    """The viewer as a process group of its own, opening `recording`."""
    command = [sys.executable, "-m", "rerun_cli", "--bind", LOOPBACK, "--hide-welcome-screen", *options, str(recording)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True, env=os.environ | _without_telemetry()
    )


def _without_telemetry() -> dict[str, str]:
    """Environment in which the viewer tells nobody how it is used: a configuration directory of its own says so."""
    directory = _own_directory()
    settings = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
    places = {"config_file_path": str(directory / "rerun/analytics.json"), "data_dir_path": str(directory / "data")}
    write_bytes(json.dumps(settings | places).encode(), directory / "rerun/analytics.json")
    return {"XDG_CONFIG_HOME": str(directory)}


def _own_directory() -> Path:
    """With a directory rerun in it; the user's own, for in one of everybody's somebody else may have laid a link."""
    kept = cache_directory()
    with suppress(OSError):  # a home that is read-only
        if kept is not None:
            (kept / "viewer/rerun").mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(kept / "viewer/rerun", os.W_OK):
                return kept / "viewer"
    made = Path(tempfile.mkdtemp(prefix="dense2sparse-viewer-"))
    (made / "rerun").mkdir()
    return made


def stop_viewer(process: subprocess.Popen[bytes], patience: float = 5.0) -> None:
    """End the viewer with its launcher, which is a process of its own."""
    for wish in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, wish)
            process.wait(patience)
        except subprocess.TimeoutExpired:
            continue
        except ProcessLookupError:
            return


def free_port() -> int:
    """A TCP port nobody listens on."""
    with socket.socket() as listener:
        listener.bind((LOOPBACK, 0))
        return int(listener.getsockname()[1])


def wait_for(port: int, process: subprocess.Popen[bytes], timeout: float) -> None:
    """Until the viewer listens on `port`.

    Raises:
        MachineError: it ended, or does not listen in time.
    """
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline and process.poll() is None:
        try:
            socket.create_connection((LOOPBACK, port), timeout=1).close()
            return
        except OSError:
            time.sleep(0.1)
    raise MachineError(
        "the Rerun viewer does not start: it needs Vulkan (`apt-get install mesa-vulkan-drivers libvulkan1`)"
    )
