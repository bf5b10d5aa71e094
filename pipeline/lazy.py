"""A command group that imports a command only when it is called: `pipeline --help` stays instant."""

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple, NoReturn

import click

from pipeline import interrupts
from pipeline.failures import report


class LazyCommand(NamedTuple):
    """Where a command lives, and its line in the group's help."""

    target: str  # module:attribute
    summary: str


class LazyGroup(click.Group):
    """Commands by name → where they live; every failure leaves through `report`."""

    def __init__(self, *args: Any, lazy: dict[str, LazyCommand], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.lazy = lazy

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the data flow."""
        return list(self.lazy)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command."""
        if cmd_name not in self.lazy:
            return None
        module, _, attribute = self.lazy[cmd_name].target.partition(":")
        command = getattr(import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click's, but an unknown command lists the valid ones."""
        if args and args[0] not in self.lazy and not args[0].startswith("-"):
            raise click.UsageError(f"unknown command {args[0]!r}; valid: {', '.join(self.lazy)}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table of commands, from the summaries: nothing is imported."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.summary) for name, command in self.lazy.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """As click's, but a reader that has read enough (`| head`) is no failure, and a file that ends no interrupt."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter complains at its end
            return 0
        except EOFError as error:  # click takes it for the end of what the user types
            raise RuntimeError(f"end of a file: {error}") from error

    def main(self, args: Sequence[str] | None = None, *rest: Any, **options: Any) -> NoReturn:
        """Run and exit: 0, or the failure's exit code."""
        arguments = list(sys.argv[1:] if args is None else args) or ["--help"]
        options["standalone_mode"] = False
        try:
            code = super().main(arguments, *rest, **options)
        except (Exception, KeyboardInterrupt) as error:
            interrupts.over()
            code = report(error, arguments)
        interrupts.over()
        sys.exit(code if isinstance(code, int) else 0)
