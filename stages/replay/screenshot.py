"""A picture of a recording as the Rerun viewer shows it, without a screen (needs a Vulkan driver; Mesa's will do)."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rerun.experimental import ViewerClient

from schemas.errors import MachineError
from stages.replay.viewer import LOOPBACK, free_port, start_viewer, stop_viewer, wait_for

_START_TIMEOUT = 30.0  # [s]
_LOAD_TIMEOUT = 30.0  # [s]


def screenshot(
    recording: Path, png: Path, *, fraction: float = 0.5, size: tuple[int, int] = (1600, 1000), settle: float = 6.0
) -> list[str]:
    """Save what the viewer shows of `recording`, its time cursor at `fraction` of the blueprint's timeline.

    `settle` [s] is left for images to reach the screen, and for the viewer's own notices to leave it. Returns what the
    views reported as wrong.

    Raises:
        MachineError: the viewer does not start here, or does not load the recording.
    """
    with _headless(recording, size) as viewer:
        _move_cursor(viewer, fraction)
        time.sleep(settle)
        png.write_bytes(viewer.take_screenshot())
        return [f"{view.name}: {report.summary}" for view in viewer.get_state().views for report in view.reports]


@contextmanager
def _headless(recording: Path, size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = free_port()
    window = f"{size[0]}x{size[1]}"
    process = start_viewer(recording.resolve(), "--headless", "--port", str(port), "--window-size", window)
    try:
        wait_for(port, process, _START_TIMEOUT)
        viewer = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
        _wait_until_loaded(viewer, recording)
        yield viewer
    finally:
        stop_viewer(process)


def _wait_until_loaded(viewer: ViewerClient, recording: Path) -> None:
    deadline = time.monotonic() + _LOAD_TIMEOUT
    while time.monotonic() < deadline:
        state = viewer.get_state()
        if state.recordings and state.recordings[0].timelines and not state.loading:
            return
        time.sleep(0.2)
    raise MachineError(f"the Rerun viewer does not load {recording}")


def _move_cursor(viewer: ViewerClient, fraction: float) -> None:
    shown = viewer.get_state().recordings[0]
    for timeline in shown.timelines:
        if timeline.name == shown.current_timeline and timeline.start is not None and timeline.end is not None:
            at = round(timeline.start + fraction * (timeline.end - timeline.start))
            viewer.set_time(timeline.name, sequence=at, play_state="paused")  # an integer of the timeline's own unit
