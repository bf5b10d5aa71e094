"""Answers and results as files: SQL, CSV and Parquet beside the report."""

from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import pyarrow as pa

from schemas.files import write_bytes, write_parquet
from stages.analyze.results import Comparison, Group, Row, flat
from stages.analyze.study import Answer
from stages.analyze.writers import write_csv


def write_all(
    directory: Path, answers: dict[str, Answer], groups: Sequence[Group], paper: Sequence[Comparison]
) -> None:
    """Write `directory`/NAME.{csv,parquet} for every answer with rows and each table, and every question's NAME.sql."""
    for name, answer in answers.items():
        write_bytes(answer.sql.encode(), directory / f"{name}.sql")
        _write(directory, name, answer.rows)
    _write(directory, "results", flat(groups))
    _write(directory, "paper", [_paper_row(row) for row in paper])


def _write(directory: Path, name: str, rows: list[Row]) -> None:
    table = pa.Table.from_pylist(rows)
    text = StringIO()
    write_csv(table.schema, table.to_batches(), text)
    write_bytes(text.getvalue().encode(), directory / f"{name}.csv")
    write_parquet(table, directory / f"{name}.parquet")


def _paper_row(row: Comparison) -> Row:
    paper, ours = row.paper, row.group
    return {
        "task": paper.task,
        "misalignment_deg": float(paper.misalignment_deg),
        "misalignment_kind": None if ours is None else ours.misalignment_kind,
        "scheme": paper.scheme,
        "name": None if ours is None else ours.name,
        "paper_return": None if paper.episode_return is None else float(paper.episode_return),
        "return": None if ours is None or ours.returns is None else ours.returns.mean,
        "paper_success_rate": paper.success_rate,
        "success_rate": None if ours is None or ours.success is None else ours.success.mean,
        "seeds": 0 if ours is None else len(ours.seeds),
        "source": paper.source,
    }
