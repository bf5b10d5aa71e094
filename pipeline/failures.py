"""From exceptions to exit codes: one short message on stderr (SPEC §1)."""

import errno
import json
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import click

from pipeline.text import printable, shortened

RESUMABLE = ("collect", "train-perception", "train-policy")
_NO_PLACE = (errno.ENAMETOOLONG, errno.ELOOP)
"""What the system says of paths that nothing can have."""
_SQL = "SQL: "
"""Begins the messages of more than a line: below DuckDB's the place is shown."""


class Failure(NamedTuple):
    """How a command ends that did not succeed."""

    exit_code: int
    kind: str
    message: str
    details: Mapping[str, Any] = {}


def classify(error: BaseException, arguments: Sequence[str]) -> Failure:
    """Exit code and message of an exception."""
    from pipeline.exhausted import message
    from schemas.errors import PipelineError

    if isinstance(error, (KeyboardInterrupt, click.Abort)):
        return Failure(130, "Interrupted", _interrupted(arguments))
    if isinstance(error, click.ClickException):
        return Failure(2, "UsageError", _usage(error))
    if isinstance(error, PipelineError):
        return Failure(error.exit_code, type(error).__name__, str(error), error.details)
    command = _command(arguments)
    exhausted = message(error, command, command in RESUMABLE)
    return Failure(4, "MachineError", exhausted) if exhausted else _unexpected(error)


def _command(arguments: Sequence[str]) -> str:
    return next((each for each in arguments if not each.startswith("-")), "")


def _interrupted(arguments: Sequence[str]) -> str:
    command = _command(arguments)
    if command in RESUMABLE:
        return "interrupted; the same command with --resume goes on from the last checkpoint"
    if command == "run":
        return "interrupted; the same command goes on from the last checkpoint"
    return "interrupted"


def _usage(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    hint = f" (see `{context.command_path} --help`)" if context else ""
    return error.format_message().rstrip(".") + hint


def _unexpected(error: BaseException) -> Failure:
    if isinstance(error, OSError) and error.errno in _NO_PLACE:
        return Failure(2, "ConfigError", f"{error.filename} can be no file ({error.strerror}): choose another name")
    text = str(error).strip().splitlines()
    reason = f"{type(error).__name__}: {text[0]}" if text else type(error).__name__
    return Failure(4, type(error).__name__, f"unexpected {reason} (--debug shows where)")


def report(error: BaseException, arguments: Sequence[str]) -> int:
    """Tell the user; returns the exit code. `--json` also gets an object on stdout, `--debug` a traceback."""
    failure = classify(error, arguments)
    if "--debug" in arguments:
        traceback.print_exception(error, file=sys.stderr)
    kept = "\n" if failure.message.startswith(_SQL) else ""
    click.echo(f"Error: {printable(shortened(failure.message), kept)}", err=True)
    if "--json" in arguments:
        said = {"type": failure.kind, "message": failure.message, "exit_code": failure.exit_code}
        with suppress(OSError):  # it may be stdout that is full
            click.echo(json.dumps({"error": {**said, **failure.details}}))
    return failure.exit_code
