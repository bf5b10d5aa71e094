"""Rerun recordings (.rrd) of an episode file as it is, laid out like every episode."""

from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from rerun.chunk import McapReader

from rerun_blueprints.episode import episode_blueprint
from schemas.errors import ArtifactError
from stages.replay.recording_file import recording_file

_TIMELINE = "message_log_time"  # Rerun's, of the log time of messages


def record_mcap(path: Path, save: Path) -> int:
    """Write a recording of every message of an MCAP file to `save`; returns the number of topics.

    The file alone has no meshes: `record_dataset_episode` shows the arm.

    Raises:
        ArtifactError: it is no MCAP file, or damaged.
        MachineError: there is no space.
    """
    _check(path)
    blueprint = episode_blueprint(estimated=False, rewarded=False, plots=False, timeline=_TIMELINE)
    topics: set[str] = set()
    with recording_file(path.name, save, blueprint) as recording:
        try:
            for chunk in McapReader(path).stream():
                recording.send_chunks(chunk)
                topics.add(chunk.entity_path)
        except (McapError, ValueError, RuntimeError) as error:
            raise ArtifactError(f"{path} cannot be read as MCAP ({error})") from error
    return len(topics)


def _check(path: Path) -> None:
    """Rerun's reader takes the lengths that a damaged file gives at their word, and ends the process over them."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Chunk):
                    _, length = get_chunk_data_stream(record, validate_crc=True)
                    if length != record.uncompressed_size:
                        raise ValueError(f"a chunk of {length} bytes says it has {record.uncompressed_size}")
    except Exception as error:  # damaged bytes surface as errors of mcap, struct, zstandard or lz4
        reason = str(error) or type(error).__name__
        raise ArtifactError(f"{path} cannot be read as MCAP ({reason}): see `pipeline repair`") from error
