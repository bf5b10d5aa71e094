"""SQL over all logs: checked, streamed, written as text or Parquet."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from pathlib import Path
from typing import TextIO

import duckdb
import pyarrow as pa

from schemas.errors import ArtifactError, ConfigError, MachineError, unknown_choice
from stages.analyze import guard, macros
from stages.analyze.catalogue import Kind, artifacts, check_transitions, first_damaged
from stages.analyze.pinned import by_name
from stages.analyze.views import connect
from stages.analyze.writers import TEXT_WRITERS, write_parquet_stream

BATCH_ROWS = 10_000
_LOGS: tuple[Kind, ...] = ("runs", "relabels")
"""Kinds of artifacts with transitions."""
_FILE = re.compile(r"\W")
"""In what stands for a table: it is no view's name but a file's, or that of many."""
_USERS = tuple(f"SQL: {kind} Error" for kind in ("Parser", "Binder", "Catalog", "Permission", "Conversion"))
"""Errors that are of the query, whatever the logs hold."""
FORMATS = (*TEXT_WRITERS, "parquet")


def query(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.RecordBatchReader:
    """The answer to one reading statement, as a stream of batches.

    Raises:
        ConfigError: the statement is refused or wrong; DuckDB's message points at the spot.
    """
    return _answer(connection, guard.check(connection, sql))


def _answer(connection: duckdb.DuckDBPyConnection, statement: guard.Statement) -> pa.RecordBatchReader:
    try:
        return connection.sql(statement.text).to_arrow_reader(BATCH_ROWS)
    except duckdb.InterruptException:
        raise KeyboardInterrupt from None
    except duckdb.Error as error:
        raise _sql_error(_located(connection, statement, error)) from None


def write(reader: pa.RecordBatchReader, format: str, target: TextIO | Path) -> int:
    """Write the stream as `format` to an open text stream, or to a file that is whole or absent; returns the rows.

    Raises:
        ConfigError: an unknown format, Parquet to a text stream, or an SQL error met on the way.
        ArtifactError: a damaged file met on the way.
        MachineError: the file cannot be written.
    """
    if format not in FORMATS:
        raise ConfigError(unknown_choice("format", format, FORMATS))
    if not isinstance(target, Path):
        if format == "parquet":
            raise ConfigError("Parquet is no text: name a file with -o FILE.parquet")
        return TEXT_WRITERS[format](reader.schema, _batches(reader), target)
    if target.is_dir() or not target.parent.is_dir():
        raise ConfigError(f"cannot write {target}: it is a directory or lies in none")
    temporary = target.with_name(f".{target.name}.tmp")
    try:
        rows = _to_file(reader, format, temporary)
        temporary.replace(target)
    except OSError as error:
        raise MachineError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
    return rows


def run_sql(data_root: Path, sql: str, format: str, output: Path | None, stream: TextIO) -> int:
    """Answer `sql` over the artifacts under `data_root`, into the file `output` or else `stream`; returns the rows.

    The work is a thread's: DuckDB does not look for Ctrl-C while it computes, this thread does and stops it.
    """
    if output is None and format == "parquet":
        raise ConfigError("Parquet is no text: name a file with -o FILE.parquet")
    target = stream if output is None else output
    with connect(data_root) as connection, ThreadPoolExecutor(1) as thread:
        statement = guard.check(connection, sql)
        if any(source in _of_transitions() or _FILE.search(source) for source in statement.sources):
            check_transitions([artifact for kind in _LOGS for artifact in artifacts(data_root, kind)])
        rows = thread.submit(lambda: write(_answer(connection, statement), format, target))
        try:
            while not wait([rows], timeout=0.2).done:  # a signal may reach another thread and not wake this one
                pass
            return rows.result()
        except ConfigError as error:
            if not str(error).startswith(_USERS):
                _blame_damage(data_root, error)
            raise
        except KeyboardInterrupt:
            while not wait([rows], timeout=0.2).done:
                connection.interrupt()
            raise


def _blame_damage(data_root: Path, error: ConfigError) -> None:
    """ArtifactError where a log is not what was written: DuckDB has many words for what it then stumbles over."""
    for kind in _LOGS:
        for artifact in artifacts(data_root, kind):
            if damaged := first_damaged(artifact):
                raise ArtifactError(f"a log is damaged: {artifact.path / damaged} ({error}); make it again") from error


@cache
def _of_transitions() -> frozenset[str]:
    """What a statement names that reads transitions: the views, the macros that ask them, and what opens files."""
    views = ("transitions", "relabelled_transitions")
    asking = {macro.name for macro in macros.macros() if any(view in macro.body for view in views)}
    return frozenset({*views, *asking, "read_parquet", "parquet_scan"})


def _to_file(reader: pa.RecordBatchReader, format: str, path: Path) -> int:
    if format == "parquet":
        return write_parquet_stream(reader.schema, _batches(reader), path)
    with path.open("w", encoding="utf-8", newline="") as file:
        return TEXT_WRITERS[format](reader.schema, _batches(reader), file)


def _batches(reader: pa.RecordBatchReader) -> Iterator[pa.RecordBatch]:
    """The batches; what goes wrong while DuckDB computes them is an error of the query, not of the writing."""
    while True:
        try:
            batch = reader.read_next_batch()
        except StopIteration:
            return
        except (duckdb.Error, pa.ArrowException, OSError) as error:
            raise _sql_error(str(error)) from None
        yield batch


def _located(connection: duckdb.DuckDBPyConnection, statement: guard.Statement, error: duckdb.Error) -> str:
    """DuckDB's message with the line and the mark; relations leave them out of binder errors, statements do not."""
    message = str(error)
    if "LINE" not in message:
        try:
            connection.execute(statement.text)
        except duckdb.Error as located:
            message = str(located)
    before = statement.lines_before
    return re.sub(r"(?m)^LINE (\d+):(.*\n)", lambda line: _line(line[1], int(line[1]) + before, line[2]), message)


def _line(said: str, number: int, rest: str) -> str:
    """The line with its number in the whole text; the mark below stays under its place."""
    return f"LINE {number}:{rest}{' ' * (len(str(number)) - len(said))}"


def _sql_error(message: str) -> ConfigError | ArtifactError:
    message = by_name(message.removeprefix("Invalid Input Error: Python exception occurred while executing the UDF: "))
    damaged = "No magic bytes" in message or "too small to be a Parquet file" in message
    return ArtifactError(f"a log is damaged: {message}") if damaged else ConfigError(f"SQL: {message}")
