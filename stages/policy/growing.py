"""A table of a run's log that grows by rows and is written anew with them: a row per episode, evaluation, or window."""

from pathlib import Path
from typing import Any

import pyarrow as pa

from schemas.arrays import with_own_words
from schemas.errors import ArtifactError
from schemas.files import read_parquet, write_parquet
from stages.policy.ownership import require_own


class Growing:
    """The file is the table; in memory is what was added since, and of the rest no lists: states would fill it."""

    def __init__(self, path: Path, schema: pa.Schema, identity: dict[str, Any]) -> None:
        self._path, self._schema, self._identity = path, schema, identity
        self._new: list[dict[str, Any]] = []
        self._names = [f.name for f in schema if f.name not in identity and not pa.types.is_nested(f.type)]
        self._written = schema.empty_table().select(self._names)

    def __len__(self) -> int:
        return self._written.num_rows + len(self._new)

    def add(self, row: dict[str, Any]) -> None:
        """A row without the run's identity."""
        self._new.append(row)

    def rows(self) -> list[dict[str, Any]]:
        """All rows, without identity and lists, their numbers rounded as the file holds them."""
        return pa.concat_tables([self._written, self._fresh().select(self._names)]).to_pylist()

    def flush(self) -> None:
        """Write what was added since the last time."""
        if self._new or not self._path.exists():
            self._write(pa.concat_tables([self._stored(self._written.num_rows), self._fresh()]))

    def keep(self, count: int) -> None:
        """Go back to the first `count` rows.

        Raises:
            ArtifactError: there are fewer, or the file cannot be read or is another run's.
        """
        self._write(self._stored(count).slice(0, count))

    def _stored(self, count: int) -> pa.Table:
        if not count:
            return self._schema.empty_table()
        table = read_parquet(self._path)
        require_own(table, self._schema.names, self._identity, self._path)
        if table.num_rows < count:
            raise ArtifactError(
                f"{self._path} has {table.num_rows} rows, its checkpoint {count}: see `pipeline repair`"
            )
        return table.cast(self._schema)

    def _fresh(self) -> pa.Table:
        return pa.Table.from_pylist([self._identity | row for row in self._new], schema=self._schema)

    def _write(self, table: pa.Table) -> None:
        table = with_own_words(table)
        write_parquet(table, self._path)
        self._new, self._written = [], table.select(self._names)
