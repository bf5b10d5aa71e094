"""Files that are whole or absent, and where they lie."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from schemas.errors import ArtifactError

T = TypeVar("T")
_DICTIONARY = ("misalignment_deg", "seed", "episode")
"""Numbers that repeat over whole episodes and that questions group by."""
CHECKED = {"page_checksum_verification": True}
"""How pyarrow reads: a flipped bit would be another number."""
_LIST_LEVEL = 6
"""Of brotli for lists of floats: its contexts see that every row repeats the numbers of the one before, nearly."""


def write_parquet(table: pa.Table, path: Path) -> None:
    """Write `table` under a temporary name, fsync, and rename to `path`."""
    with published(path) as file:
        pq.write_table(table, file, **parquet_settings(table.schema))


def parquet_settings(schema: pa.Schema) -> dict[str, Any]:
    """How the columns are encoded: each file is smaller and faster to write and to query than by pyarrow's defaults.

    Measured values hardly ever repeat, so that a dictionary of them is of no use; split into a stream per byte, their
    signs and exponents compress. `python -m benchmarks log` and `query` measure both.
    """
    encoding: dict[str, str] = {}
    compression: dict[str, str] = {}
    levels: dict[str, int] = {}
    for field in schema:
        is_list = pa.types.is_list(field.type) or pa.types.is_fixed_size_list(field.type)
        kind = field.type.value_type if is_list else field.type
        column = f"{field.name}.list.element" if is_list else field.name
        compression[column] = "zstd"
        if pa.types.is_floating(kind) and column not in _DICTIONARY:
            encoding[column] = "BYTE_STREAM_SPLIT"
            if is_list:
                compression[column], levels[column] = "brotli", _LIST_LEVEL
        elif pa.types.is_integer(kind) and column not in _DICTIONARY:
            encoding[column] = "DELTA_BINARY_PACKED"
    return {
        "use_dictionary": [column for column in compression if column not in encoding],
        "column_encoding": encoding or None,
        "compression": compression or "zstd",
        "compression_level": levels or None,
        "write_page_checksum": True,
    }


def read_parquet(path: Path, columns: list[str] | None = None, missing: str | None = None) -> pa.Table:
    """The table of a file, or some of its columns; its checksums are verified.

    Raises:
        ArtifactError: it is missing (`missing` says what that means), or not what was written.
    """
    if not path.is_file():
        meaning = f"{missing}: there is no {path}" if missing else f"there is no {path}: restore it or make it again"
        raise ArtifactError(meaning)
    return reading(path, lambda: _whole_table(path, columns=columns))


def read_rows(path: Path, wanted: "pa.dataset.Expression") -> pa.Table:
    """The rows of a table that are wanted, its checksums verified; ArtifactError where it is not what was written."""
    return reading(path, lambda: _whole_table(path, filters=wanted))


def _whole_table(path: Path, **which: Any) -> pa.Table:
    with pa.OSFile(str(path)) as file:  # opened once: while a run is trained another file takes its place
        return pq.read_table(file, **which, **CHECKED)


def reading(path: Path, read: Callable[[], T]) -> T:
    """What `read` returns, which reads from `path`; ArtifactError where that is damaged."""
    try:
        return read()
    except (OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise ArtifactError(f"{path} is damaged or not Parquet ({reason}): restore it or make it again") from error


def write_bytes(data: bytes, path: Path) -> None:
    """Write `data` under a temporary name, fsync, and rename to `path`."""
    with published(path) as file:
        file.write(data)


@contextmanager
def published(path: Path, *, durable: bool = True) -> Iterator[BinaryIO]:
    """A file that becomes `path` when the block ends; what was written of it goes when the block raises.

    Not `durable`, it may be lost or damaged when the machine itself goes down soon after.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # a write does not know it
        temporary.unlink(missing_ok=True)  # on a full disk half a file would take the room that the next try needs
        raise
    if durable:
        fsync_directory(path.parent)


def remove_halves(directory: Path) -> None:
    """Remove what a killed process was writing below `directory`, files and directories, where that is allowed."""
    for half in list(directory.rglob(".*.tmp")):
        if half.is_dir():
            shutil.rmtree(half, ignore_errors=True)
        else:
            with suppress(OSError):  # a disk that became read-only: why the work ended is told, not this
                half.unlink()


def fsync_directory(directory: Path) -> None:
    """Make the renames in `directory` durable."""
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def transition_parts(run: Path) -> list[Path]:
    """The files of a run's transitions, in order."""
    return sorted((run / "transitions").glob("part-*.parquet"))


def leads_out(path: Path, directory: Path) -> bool:
    """Followed to its end, `path` is not below `directory`: by `..`, by a link, or because it is no path at all."""
    try:
        return not path.resolve().is_relative_to(directory.resolve())
    except (OSError, ValueError, RuntimeError):  # a name too long, one with NUL in it, links in a circle
        return True


def failure_path(artifact: Path) -> Path:
    """Where what failed in an episode keeps it: a run as transitions/ and episodes.parquet, a dataset as one table."""
    return artifact / "failure"


def recording_path(run: Path, split: str, episode: int) -> Path:
    """Where a run keeps the frames of an episode that were recorded while it was made."""
    return run / "recordings" / f"{split}-{episode:06d}.mcap"
