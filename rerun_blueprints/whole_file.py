"""A recording that becomes a file when all of it is there."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from schemas.files import write_bytes


@contextmanager
def recorded(recording: rr.RecordingStream, path: Path, blueprint: rrb.Blueprint) -> Iterator[None]:
    """What is logged to `recording` in this block is the file `path` after it, whole, or not there when it raises.

    It is in memory until then: Rerun's own writer of files is a thread that tells nobody when the disk is full, and
    that whoever ends the recording then waits for, now and then for good.

    Raises:
        OSError: it cannot be written.
    """
    stream = rr.binary_stream(recording)
    recording.send_blueprint(blueprint, make_active=False)
    try:
        yield
        data = stream.read() or b""
    finally:
        recording.disconnect()
    write_bytes(data, path)
