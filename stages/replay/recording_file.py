"""A Rerun recording on disk that is whole or absent, with its blueprint inside."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from rerun_blueprints.whole_file import recorded
from schemas.entities import APPLICATION_ID
from schemas.errors import ConfigError, MachineError


@contextmanager
def recording_file(name: str, save: Path, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Open a recording that is published as `save` when the block ends without an error.

    Raises:
        ConfigError: `save` is in no directory.
        MachineError: it cannot be written.
    """
    if not save.parent.is_dir():
        raise ConfigError(f"cannot write {save}: there is no directory {save.parent}")
    recording = rr.RecordingStream(APPLICATION_ID)
    try:
        with recorded(recording, save, blueprint):
            recording.send_recording_name(name)
            yield recording
    except OSError as error:
        raise MachineError(f"cannot write {save}: {error.strerror or error}; mend that, then try again") from error
