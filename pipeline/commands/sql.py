"""`pipeline sql`."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, cast

import click

from pipeline.commands.options import Place, place_options

if TYPE_CHECKING:
    from rich.table import Table

    from stages.analyze.describe import Column

FORMATS = ("table", "csv", "json", "parquet")


@click.command(
    epilog="""\b
Example:
  pipeline sql "SELECT run, final_return, final_success_rate FROM runs ORDER BY run"
  pipeline sql "FROM return_by_scheme()"
  pipeline sql question.sql --format parquet -o answer.parquet
  pipeline sql -
  pipeline sql --schema transitions
"""
)
@place_options
@click.argument("query", metavar="QUERY|FILE.sql|-", required=False)
@click.option(
    "--format",
    "format_",
    type=click.Choice(FORMATS),
    help="Of the rows.  [default: as FILE ends, else table]",
)
@click.option(
    "-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="File to write instead of stdout."
)
@click.option("--schema", is_flag=True, help="Show the views with their columns, and the macros; or one of them.")
def sql(options: Place, query: str | None, format_: str | None, output: Path | None, schema: bool) -> None:
    """Ask SQL over all logs.

    Views: runs, episodes, transitions, evaluations, updates, datasets, frames, estimators, epochs, predictions,
    relabels, relabelled_episodes, relabelled_transitions; macros for the usual questions: `--schema` lists both.
    DuckDB's dialect; reading only. The query is an argument, a file, or comes on stdin. With --json: one object
    {"rows": […]}.
    """
    from schemas.errors import ArtifactError, ConfigError

    if schema:
        _show_schema(options, query)
        return
    if not options.data.is_dir():
        raise ArtifactError(f"no data root {options.data}: run `pipeline run demo` first, or name another with --data")
    if options.as_json and (format_ or output):
        raise ConfigError("--json prints one object: leave out --format and -o, or use --format json")
    text = _text(query)
    from stages.analyze.query import run_sql

    if options.as_json:
        run_sql(options.data, text, "json", None, cast("TextIO", _Object(sys.stdout)))
        click.echo("}")
        return
    rows = run_sql(options.data, text, format_ or _format_of(output), output, sys.stdout)
    if output and not options.quiet:
        _say_cut(rows, format_ or _format_of(output), output)


class _Object:
    """A stream that puts the beginning of an object before the first text: where there is an error there is none."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._begun = stream, False

    def write(self, text: str) -> int:
        """Write text."""
        if not self._begun:
            self._stream.write('{"rows": ')
            self._begun = True
        return self._stream.write(text)


def _say_cut(rows: int, form: str, output: Path) -> None:
    """A table shows the first rows only, in a file too."""
    from stages.analyze.writers import TABLE_ROWS

    if form == "table" and rows > TABLE_ROWS:
        click.echo(
            f"{output} has the first {TABLE_ROWS} of {rows:,} rows: --format csv, json or parquet has all", err=True
        )


def _show_schema(options: Place, view: str | None) -> None:
    """All views and macros, or one of them."""
    from rich.markup import escape

    from pipeline.output import console, print_json
    from schemas.errors import ConfigError, unknown_choice
    from stages.analyze.describe import views
    from stages.analyze.macros import macros

    known = views()
    chosen = {name: listed for name, listed in known.items() if view in (None, name)}
    called = [macro for macro in macros() if view in (None, macro.name)]
    if not chosen and not called:
        raise ConfigError(unknown_choice("view or macro", str(view), [*known, *(macro.name for macro in macros())]))
    if options.as_json:
        columns = {name: [asdict(column) for column in listed] for name, listed in chosen.items()}
        print_json({"views": columns, "macros": [asdict(macro) for macro in called]})
        return
    for name, listed in chosen.items():
        console().print(_view_table(name, listed), "")
    for macro in called:
        console().print(
            f"[bold]{escape(macro.signature)}[/]  {escape(macro.meaning)}\n  [dim]{escape(macro.example)}[/]"
        )


def _view_table(name: str, columns: "list[Column]") -> "Table":
    from pipeline.output import table

    made = table("column", "type", "meaning", title=f"[bold]{name}[/]")
    for column in columns:
        made.add_row(column.name, column.type, column.meaning)
    return made


def _format_of(output: Path | None) -> str:
    """The format that a file's name asks for."""
    from schemas.errors import ConfigError

    if output is None:
        return "table"
    suffix = output.suffix.removeprefix(".")
    if suffix not in FORMATS:
        raise ConfigError(f"-o {output}: a file ends in .csv, .json or .parquet, or name its format with --format")
    return suffix


def _text(query: str | None) -> str:
    """The query, what the file holds that it names, or what comes on stdin."""
    from schemas.errors import ConfigError

    if query is None and sys.stdin.isatty():
        raise ConfigError('no query: give one ("SELECT …"), a FILE.sql, or pipe one in; --schema shows what there is')
    if query is None or query == "-":
        return _decoded(sys.stdin.buffer.read(), "stdin")
    if not query.endswith(".sql"):
        return query
    try:
        return _decoded(Path(query).read_bytes(), query)
    except OSError as error:
        raise ConfigError(f"cannot read {query}: {error}") from error


def _decoded(data: bytes, source: str) -> str:
    from schemas.errors import ConfigError

    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"cannot read {source}: {error}") from error
