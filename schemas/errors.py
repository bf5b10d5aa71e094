"""Errors every room raises; the command line turns each into one message and an exit code (SPEC §1)."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

_LISTED = 30  # names that a message can hold
_RESEMBLING = 5  # of more than that


class PipelineError(Exception):
    """An expected failure. The message says what is wrong, where, and what to do about it."""

    exit_code = 4
    details: Mapping[str, Any] = {}
    """What `--json` says besides the message."""


class ConfigError(PipelineError):
    """Wrong usage or configuration."""

    exit_code = 2


class ArtifactError(PipelineError):
    """An input artifact is missing, damaged, foreign or of an unknown schema version.

    `awaited`: making what is not there yet, or not finished, would mend it.
    """

    exit_code = 3

    def __init__(self, message: str, awaited: bool = False) -> None:
        super().__init__(message)
        self.awaited = awaited


class MachineError(PipelineError):
    """This machine cannot do it: no GL, disk full, no GPU where one was asked for."""

    exit_code = 4


class DivergedError(MachineError):
    """The work itself came to a bad end, an unstable simulation or values that are no numbers: its artifact failed."""


def unknown_choice(what: str, given: str, valid: Iterable[str]) -> str:
    """Message for a name that is not one of the valid ones, listing them."""
    return f"unknown {what} {given!r}; valid: {listed(given, valid)}"


def listed(given: str, valid: Iterable[str]) -> str:
    """The valid names; of many those that resemble what was given, and how many more there are."""
    names = sorted(valid)
    if len(names) <= _LISTED:
        return ", ".join(names)
    shown = get_close_matches(given, names, _RESEMBLING, cutoff=0.3) or names[:_RESEMBLING]
    return f"{', '.join(shown)} and {len(names) - len(shown)} more"
