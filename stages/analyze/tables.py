"""Answers and what is derived from them as files: SQL, CSV and Parquet beside the report, and back again."""

from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from schemas.files import write_bytes, write_parquet
from stages.analyze.results import Answer, Row
from stages.analyze.writers import write_csv


def write_all(directory: Path, answers: Mapping[str, Answer], derived: Mapping[str, list[Row]]) -> None:
    """Write `directory`/NAME.{csv,parquet} for every answer and derived table, and every question's NAME.sql."""
    for name, answer in answers.items():
        write_bytes(answer.sql.encode(), directory / f"{name}.sql")
        _write(directory, name, answer.rows)
    for name, rows in derived.items():
        _write(directory, name, rows)


def _write(directory: Path, name: str, rows: list[Row]) -> None:
    table = pa.Table.from_pylist(rows)
    text = StringIO()
    write_csv(table.schema, table.to_batches(), text)
    write_bytes(text.getvalue().encode(), directory / f"{name}.csv")
    write_parquet(table, directory / f"{name}.parquet")


def read_answers(directory: Path) -> dict[str, Answer]:
    """The answers that `write_all` wrote: the tables that have a question beside them."""
    return {
        path.stem: Answer(path.read_text(encoding="utf-8"), pq.read_table(path.with_suffix(".parquet")).to_pylist())
        for path in sorted(directory.glob("*.sql"))
    }
