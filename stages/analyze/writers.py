"""Streams of record batches as text or Parquet, one batch in memory at a time."""

import csv
import json
import math
from collections.abc import Callable, Iterable
from datetime import date, datetime, time
from decimal import Decimal
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

TABLE_ROWS = 100
"""Rows shown by the table format; the other formats have all."""
CELL_WIDTH = 60

Batches = Iterable[pa.RecordBatch]


def write_csv(schema: pa.Schema, batches: Batches, stream: TextIO) -> int:
    """Comma-separated values with a header; a null is empty, a list is JSON."""
    csv.writer(stream, lineterminator="\n").writerow(schema.names)
    rows = 0
    for batch in batches:
        columns = [pl.Series(str(i), _csv_column(column)) for i, column in enumerate(batch.columns)]
        stream.write(pl.DataFrame(columns).write_csv(include_header=False))
        rows += batch.num_rows
    return rows


def _csv_column(column: pa.Array) -> pa.Array:
    """The column as numbers, booleans or text."""
    kind = column.type
    if _is_number(kind) or pa.types.is_boolean(kind) or pa.types.is_string(kind):
        return column
    if pa.types.is_list(kind) and pa.types.is_floating(kind.value_type):
        return _float_lists(column)
    texts = [None if value is None else _text(_jsonable(value)) for value in column.to_pylist()]
    return pa.array([None if text is None else str(text) for text in texts], pa.string())


def _float_lists(column: pa.ListArray) -> pa.Array:
    """Lists of numbers as JSON without a Python object for each: observations and actions are most of a log."""
    numbers = column.flatten()
    known = pc.if_else(pc.is_finite(numbers), numbers.cast(pa.string()), "null").fill_null("null")
    lengths = pc.list_value_length(column).fill_null(0)
    offsets = pa.array(np.concatenate([[0], np.cumsum(lengths)]), pa.int32())
    joined = pc.binary_join(pa.ListArray.from_arrays(offsets, known), ", ")
    return pc.if_else(column.is_valid(), pc.binary_join_element_wise("[", joined, "]", ""), None)


def write_json(schema: pa.Schema, batches: Batches, stream: TextIO) -> int:
    """One array of one object a row, each on its own line; NaN and infinity, which JSON lacks, are null."""
    rows = 0
    stream.write("[")
    for batch in batches:
        for values in zip(*_columns(batch), strict=True):
            record = {name: _jsonable(value) for name, value in zip(schema.names, values, strict=True)}
            stream.write((",\n" if rows else "\n") + json.dumps(record, ensure_ascii=False, allow_nan=False))
            rows += 1
    stream.write("\n]\n" if rows else "]\n")
    return rows


def _jsonable(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):  # DuckDB's maps come as lists of pairs
        return [_jsonable(item) for item in value]
    if isinstance(value, dict):
        return {str(key): _jsonable(item) for key, item in value.items()}
    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, bytes):
        return value.hex()
    return value if value is None or isinstance(value, str | int) else str(value)


def write_table(schema: pa.Schema, batches: Batches, stream: TextIO) -> int:
    """Aligned columns; the first rows, and a note when there are more. Text of several lines (EXPLAIN) stays whole."""
    shown: list[list[str]] = []
    rows = 0
    for batch in batches:
        part = batch.slice(0, max(0, TABLE_ROWS - len(shown)))
        shown.extend([_cell(value) for value in row] for row in zip(*_columns(part), strict=True))
        rows += batch.num_rows
    if any("\n" in cell for row in shown for cell in row):
        stream.writelines(f"{name}:\n{cell}\n" for row in shown for name, cell in zip(schema.names, row, strict=True))
    else:
        _write_aligned(schema, shown, stream)
    if rows > TABLE_ROWS:
        stream.write(f"… {rows - TABLE_ROWS:,} more rows of {rows:,}: use --format csv, json or parquet for all\n")
    return rows


def _columns(batch: pa.RecordBatch) -> list[list[Any]]:
    return [column.to_pylist() for column in batch.columns]


def _write_aligned(schema: pa.Schema, rows: list[list[str]], stream: TextIO) -> None:
    widths = [max(map(len, column)) for column in zip(schema.names, *rows, strict=True)]
    right = [_is_number(field.type) for field in schema]

    def line(cells: list[str]) -> str:
        parts = [c.rjust(w) if r else c.ljust(w) for c, w, r in zip(cells, widths, right, strict=True)]
        return "  ".join(parts).rstrip() + "\n"

    stream.write(line(schema.names))
    stream.write(line(["─" * width for width in widths]))
    stream.writelines(line(row) for row in rows)


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def _cell(value: Any) -> str:
    text = _shown(value)
    return text if len(text) <= CELL_WIDTH or "\n" in text else text[: CELL_WIDTH - 1] + "…"


def _shown(value: Any) -> str:
    """A value as people read it: six digits of a number, also of one in a list."""
    if value is None:
        return "·"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return str(_text(value))


def _text(value: Any) -> Any:
    return json.dumps(_jsonable(value), ensure_ascii=False) if isinstance(value, list | tuple | dict) else value


def write_parquet_stream(schema: pa.Schema, batches: Batches, path: Path) -> int:
    """zstd-compressed Parquet."""
    rows = 0
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for batch in batches:
            writer.write_batch(batch)
            rows += batch.num_rows
    return rows


TEXT_WRITERS: dict[str, Callable[[pa.Schema, Batches, TextIO], int]] = {
    "table": write_table,
    "csv": write_csv,
    "json": write_json,
}
