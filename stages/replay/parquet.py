"""Reads Parquet files of artifacts: what is wrong with one is said in a sentence."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from schemas.errors import ArtifactError

T = TypeVar("T")


def read_parquet(path: Path, missing: str) -> pa.Table:
    """The whole file.

    Raises:
        ArtifactError: it is missing (the message begins with `missing`) or damaged.
    """
    if not path.is_file():
        raise ArtifactError(f"{missing}: there is no {path}")
    return reading(path, lambda: pq.read_table(path))


def reading(path: Path, read: Callable[[], T]) -> T:
    """What `read` returns, which reads from `path`.

    Raises:
        ArtifactError: the file is damaged.
    """
    try:
        return read()
    except (OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise ArtifactError(f"{path} is damaged or not Parquet ({reason}): restore it or make it again") from error


def check_schema(found: pa.Schema, expected: pa.Schema, path: Path) -> None:
    """Pass if every expected column is there with its type.

    Raises:
        ArtifactError: one is not; names them.
    """
    missing = [name for name in expected.names if name not in found.names]
    wrong = [f.name for f in expected if f.name in found.names and found.field(f.name).type != f.type]
    if missing or wrong:
        lacks = [f"lacks {', '.join(missing)}"] if missing else []
        differs = [f"has another type of {', '.join(wrong)}"] if wrong else []
        raise ArtifactError(f"{path} is of another schema: it {' and '.join(lacks + differs)}")
