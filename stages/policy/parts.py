"""A run's transitions in part files, which at any moment hold whole episodes, from the first to the last written."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.arrays import with_own_words
from schemas.errors import ArtifactError
from schemas.files import read_parquet, reading, transition_parts, write_parquet

PART_ROWS = 40_000
"""Rows that a part has at least, but for the last, which is written anew with every addition: that, at 9 µs a row, is
what large parts cost; opening a file, which takes as long as reading 50,000 rows, is what small ones cost."""


class Parts:
    """The parts of one run; where they are cut depends on the episodes alone, not on when they were added."""

    def __init__(self, run: Path, schema: pa.Schema) -> None:
        self._run, self._schema = run, schema
        (run / "transitions").mkdir(exist_ok=True)

    def append(self, episodes: pa.Table) -> None:
        """Add rows (whole episodes) to the last part, or begin another."""
        paths = transition_parts(self._run)
        if paths and _rows(paths[-1]) < PART_ROWS:
            last = paths.pop()
            episodes = pa.concat_tables([self._read(last), episodes])
        for number, part in enumerate(_cut(episodes), start=len(paths)):
            write_parquet(part, self._run / "transitions" / f"part-{number:05d}.parquet")

    def keep(self, rows: int) -> None:
        """Drop all but the first `rows`; ArtifactError where there are fewer, or a part cannot be read."""
        paths = transition_parts(self._run)
        counts = [_rows(path) if rows else 0 for path in paths]  # to keep nothing, none needs to be readable
        if rows > sum(counts):
            raise ArtifactError(
                f"{self._run / 'transitions'} holds {sum(counts)} transitions, its episodes have {rows}: "
                "see `pipeline repair`"
            )
        for path, count in zip(reversed(paths), reversed(counts), strict=True):  # at any moment the first are there
            counts.pop()
            before = sum(counts)
            if before >= rows:
                path.unlink()
            elif before + count > rows:
                write_parquet(with_own_words(self._read(path).slice(0, rows - before)), path)

    def read(self) -> Iterator[pa.Table]:
        """Part by part."""
        return map(self._read, transition_parts(self._run))

    def _read(self, path: Path) -> pa.Table:
        """With the names that Arrow gives to what lists hold, not those that Parquet gives."""
        return read_parquet(path).cast(self._schema)


def _rows(path: Path) -> int:
    return reading(path, lambda: pq.read_metadata(path)).num_rows


def _cut(rest: pa.Table) -> Iterator[pa.Table]:
    """Whole episodes in tables of `PART_ROWS` rows or a little more; the last has what is left."""
    starts = np.flatnonzero(rest["step"].to_numpy() == 0)
    ends = np.append(starts[1:], rest.num_rows)
    begin = 0
    while begin < rest.num_rows:
        end = int(ends[min(int(np.searchsorted(ends, begin + PART_ROWS)), len(ends) - 1)])
        yield with_own_words(rest.slice(begin, end - begin))
        begin = end
