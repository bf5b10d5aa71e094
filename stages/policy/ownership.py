"""Whose log a file is: every row says so. A file that changed places has checksums of its own, and they hold."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from schemas.arrays import constant
from schemas.errors import ArtifactError
from schemas.files import read_parquet

IDENTITY = ("run", "task", "scheme", "misalignment_kind", "misalignment_deg", "seed")


def require_own(table: pa.Table, columns: Sequence[str], identity: Mapping[str, Any], path: Path) -> None:
    """Pass if `table`, read from `path`, has just these columns, and every row is of `identity`'s run.

    Raises:
        ArtifactError: it is another table, or another run's.
    """
    if odd := set(columns) ^ set(table.column_names):
        raise ArtifactError(f"{path} is another table (as its {min(odd)} shows): see `pipeline repair`")
    for name in IDENTITY if table.num_rows else ():
        column = table[name].combine_chunks()
        [own] = constant(column.type, identity[name], 1).to_pylist()
        if others := [found for found in column.unique().to_pylist() if found != own]:
            raise ArtifactError(f"{path} is of another run ({name} {others[0]}, not {own}): see `pipeline repair`")


def own_episodes(part: Path, identity: Mapping[str, Any]) -> list[tuple[str, int]]:
    """(split, number) of each episode in a part of the transitions of `identity`'s run, in order.

    Raises:
        ArtifactError: it cannot be read, or is another run's.
    """
    columns = [*IDENTITY, "split", "episode", "step"]
    table = read_parquet(part, columns)
    require_own(table, columns, identity, part)
    return episodes_of(table.filter(pa.compute.equal(table["step"], 0)))


def episodes_of(table: pa.Table) -> list[tuple[str, int]]:
    """(split, number) of each row."""
    return list(zip(table["split"].to_pylist(), table["episode"].to_pylist(), strict=True))
