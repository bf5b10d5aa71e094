"""Results on stdout: one JSON object, or text for people."""

import json
import math
from typing import Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.text import printable


def print_json(result: dict[str, Any]) -> None:
    """One JSON object; what JSON cannot say (NaN, infinity) is null."""
    click.echo(json.dumps(_finite(result), ensure_ascii=False, allow_nan=False, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def console() -> Console:
    """stdout; wide enough for a table when it is a pipe."""
    found = Console(highlight=False)
    return found if found.is_terminal else Console(highlight=False, width=160)


def note(text: str) -> None:
    """A remark on stderr."""
    click.echo(text, err=True)


class _Table(Table):
    """Its cells are text, never markup: names and reasons come from disk."""

    def add_row(self, *cells: str) -> None:  # type: ignore[override]
        """Add a row."""
        super().add_row(*(Text(printable(cell, "\n")) for cell in cells))


def table(*columns: str, title: str | None = None) -> Table:
    """A plain table; columns that begin with '#' hold numbers."""
    made = _Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for column in columns:
        made.add_column(
            Text(printable(column.removeprefix("#"))),
            justify="right" if column.startswith("#") else "left",
            overflow="fold",
        )
    return made
