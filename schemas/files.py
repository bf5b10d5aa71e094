"""Files that are whole or absent, and where they lie."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

_DICTIONARY = ("misalignment_deg", "seed", "episode")
"""Numbers that repeat over whole episodes and that questions group by."""
_LIST_LEVEL = 6
"""Of brotli for lists of floats: its contexts see that every row repeats the numbers of the one before, nearly."""


def write_parquet(table: pa.Table, path: Path) -> None:
    """Write `table` under a temporary name, fsync, and rename to `path`."""
    with _published(path) as file:
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
    }


def write_bytes(data: bytes, path: Path) -> None:
    """Write `data` under a temporary name, fsync, and rename to `path`."""
    with _published(path) as file:
        file.write(data)


@contextmanager
def _published(path: Path) -> Iterator[BinaryIO]:
    """A file that becomes `path` when the block ends; what was written of it goes when the block raises."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:  # on a full disk half a file would take the room that the next try needs
        temporary.unlink(missing_ok=True)
        raise
    fsync_directory(path.parent)


def fsync_directory(directory: Path) -> None:
    """Make the renames in `directory` durable."""
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def leads_out(path: Path, directory: Path) -> bool:
    """Followed to its end, `path` is not below `directory`: by `..`, by a link, or because it is no path at all."""
    try:
        return not path.resolve().is_relative_to(directory.resolve())
    except (OSError, ValueError, RuntimeError):  # a name too long, one with NUL in it, links in a circle
        return True


def failure_path(run: Path) -> Path:
    """Where a run that failed keeps the episode it failed in: its own transitions/ and episodes.parquet."""
    return run / "failure"


def recording_path(run: Path, split: str, episode: int) -> Path:
    """Where a run keeps the frames of an episode that were recorded while it was made."""
    return run / "recordings" / f"{split}-{episode:06d}.mcap"
