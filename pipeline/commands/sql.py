"""`pipeline sql`."""

import json
import sys
from io import StringIO
from pathlib import Path

import click

from pipeline.commands.options import Place, place_options

FORMATS = ("table", "csv", "json", "parquet")


@click.command(
    epilog="""\b
Example:
  pipeline sql "SELECT run, final_return, final_success_rate FROM runs ORDER BY run"
  pipeline sql question.sql --format parquet -o answer.parquet
"""
)
@place_options
@click.argument("query", metavar="QUERY|FILE.sql")
@click.option("--format", "format_", type=click.Choice(FORMATS), help="How to print the rows.  [default: table]")
@click.option(
    "-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="File to write instead of stdout."
)
def sql(options: Place, query: str, format_: str | None, output: Path | None) -> None:
    """Ask SQL over all logs.

    Views: runs, episodes, transitions, evaluations, updates, datasets, frames, estimators, epochs, predictions.
    DuckDB's dialect; reading only. With --json: one object {"rows": […]}.
    """
    from schemas.errors import ArtifactError, ConfigError
    from stages.analyze.query import run_sql

    if not options.data.is_dir():
        raise ArtifactError(f"no data root {options.data}: run `pipeline run demo` first, or name another with --data")
    if options.as_json and (format_ or output):
        raise ConfigError("--json prints one object: leave out --format and -o, or use --format json")
    text = _text(query)
    if not options.as_json:
        run_sql(options.data, text, format_ or _format_of(output), output, sys.stdout)
        return
    buffer = StringIO()
    run_sql(options.data, text, "json", None, buffer)
    click.echo(json.dumps({"rows": json.loads(buffer.getvalue())}, ensure_ascii=False))


def _format_of(output: Path | None) -> str:
    """The format that a file's name asks for."""
    suffix = output.suffix.removeprefix(".") if output else ""
    return suffix if suffix in FORMATS else "table"


def _text(query: str) -> str:
    """The query, or what the file holds that it names."""
    from schemas.errors import ConfigError

    if not query.endswith(".sql"):
        return query
    try:
        return Path(query).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {query}: {error}") from error
