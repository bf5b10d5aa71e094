"""Whether a Parquet file has the columns that it should."""

from pathlib import Path

import pyarrow as pa

from schemas.errors import ArtifactError


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
