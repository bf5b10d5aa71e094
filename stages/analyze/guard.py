"""What SQL is let through: one statement that only reads.

DuckDB's own confinement keeps reads inside the data root, but it would let `COPY … TO` write there, also inside a
`WITH` clause and under `EXPLAIN ANALYZE`. So the syntax tree is checked: every query node must be a reading one, and
every table function one of those that read.
"""

import json
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import duckdb

from schemas.errors import ConfigError, unknown_choice
from stages.analyze import macros

_ALLOWED = "allowed: one SELECT, WITH, FROM, VALUES, DESCRIBE, SUMMARIZE, SHOW or EXPLAIN statement"
_READING_NODES = {"SELECT_NODE", "SET_OPERATION_NODE", "RECURSIVE_CTE_NODE", "CTE_NODE"}
_TABLE_FUNCTIONS = {
    *("range", "generate_series", "unnest", "repeat", "repeat_row", "summary"),
    *("read_parquet", "parquet_scan", "parquet_schema", "parquet_metadata", "parquet_file_metadata", "glob"),
    *("read_csv", "read_csv_auto", "read_json", "read_json_auto", "json_each", "json_tree"),
    *("duckdb_columns", "duckdb_functions", "duckdb_tables", "duckdb_types", "duckdb_views", "pragma_table_info"),
}
_EXPLAIN = re.compile(r"explain(\s+analyze)?(\s*\([^()]*\))?\s+(?=\w)", re.IGNORECASE)


class Statement(NamedTuple):
    """A statement that only reads."""

    text: str
    lines_before: int  # of comments, which DuckDB leaves out when it says where an error is
    sources: frozenset[str]
    """Tables, views and table functions it names, in lower case."""


def check(connection: duckdb.DuckDBPyConnection, sql: str) -> Statement:
    """The statement in `sql`, if it is one that only reads.

    Raises:
        ConfigError: a syntax error, more or less than one statement, or one that does more than read.
    """
    try:
        statements = duckdb.extract_statements(sql)
    except duckdb.Error as error:
        raise ConfigError(f"SQL: {error}") from None
    if len(statements) != 1:
        raise ConfigError(f"SQL: {len(statements)} statements given; {_ALLOWED}")
    statement = statements[0]
    text = statement.query.strip()
    if statement.type == duckdb.StatementType.EXPLAIN:
        sources = _check_tree(connection, _explained(text))
    elif statement.type == duckdb.StatementType.SELECT:
        sources = _check_tree(connection, text)
    else:
        verb = {"LOAD": "INSTALL and LOAD"}.get(statement.type.name, statement.type.name)
        raise ConfigError(f"SQL: {verb} statements are refused, the logs are read-only; {_ALLOWED}")
    return Statement(text, sql[: max(0, sql.rfind(text))].count("\n"), sources)


def _explained(text: str) -> str:
    match = _EXPLAIN.match(text)
    if match is None:
        raise ConfigError("SQL: cannot tell what is to be explained; write EXPLAIN [ANALYZE] SELECT … without comments")
    return text[match.end() :]


def _check_tree(connection: duckdb.DuckDBPyConnection, text: str) -> frozenset[str]:
    """What the statement reads from; ConfigError where it does more than read."""
    [(serialised,)] = connection.execute("SELECT json_serialize_sql(?)", [text]).fetchall()
    try:
        tree = json.loads(serialised)
    except RecursionError:
        raise ConfigError("SQL: it is nested too deeply to be checked; use WITH for its parts") from None
    if tree["error"]:
        raise ConfigError(f"SQL: {tree.get('error_message', 'not a query')}; {_ALLOWED}")
    sources = set()
    for node in _nodes(tree):
        kind = str(node.get("type"))
        if kind.endswith("_NODE") and kind not in _READING_NODES:
            verb = kind.removesuffix("_NODE").removesuffix("_QUERY")
            raise ConfigError(f"SQL: {verb} is refused, the logs are read-only; {_ALLOWED}")
        if kind == "BASE_TABLE":
            sources.add(str(node.get("table_name")).lower())
        if kind == "TABLE_FUNCTION":
            name = str(node["function"].get("function_name")).lower()
            valid = _TABLE_FUNCTIONS | {macro.name for macro in macros.macros() if macro.is_table}
            if name not in valid:
                raise ConfigError(f"SQL: {unknown_choice('table function', name, valid)}")
            sources.add(name)
    return frozenset(sources)


def _nodes(tree: Any) -> Iterator[dict[str, Any]]:
    """Every object of a JSON tree; a stack, since expressions may nest deeper than Python's calls."""
    stack = [tree]
    while stack:
        item = stack.pop()
        if isinstance(item, dict):
            yield item
            stack.extend(item.values())
        elif isinstance(item, list):
            stack.extend(item)
