"""`pipeline doctor`."""

from typing import Any

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline doctor
  pipeline doctor --json
"""
)
@place_options
@click.pass_context
def doctor(context: click.Context, options: Place) -> None:
    """Check GL, GPU, disk and versions; say what to install.

    Exit code 4 when something that is needed is missing. A GPU is not needed.
    """
    from pipeline.doctor import examine
    from pipeline.output import print_json

    checks = examine(options.data)
    broken = [check for check in checks if not check.ok]
    if options.as_json:
        print_json({"ok": not broken, "checks": [check._asdict() for check in checks]})
    else:
        _show(checks)
    if broken:
        click.echo(
            f"Error: {len(broken)} of {len(checks)} checks failed: {', '.join(c.name for c in broken)}", err=True
        )
        context.exit(4)


def _show(checks: list[Any]) -> None:
    from pipeline.output import console, table

    made = table("", "check", "found", "what to do")
    for check in checks:
        made.add_row("ok" if check.ok else "NO", check.name, check.found, check.remedy)
    console().print(made)
