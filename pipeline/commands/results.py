"""Showing what a stage did, and what it would do."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from pipeline.commands.options import Place, StageOptions
from pipeline.output import console, note, print_json, table
from pipeline.steps.session import Outcome, Session
from pipeline.units import duration, figure

if TYPE_CHECKING:
    from pipeline.steps.studies import LeftOut

_WORDS = {
    "made": "done",
    "resumed": "resumed and done",
    "nothing": "already complete, nothing to do",
    "failed": "FAILED",
}


def session(options: StageOptions, resume: bool | None = None) -> Session:
    """What the steps of this command work with."""
    return Session(options.store, options.config, options.progress, options.resume if resume is None else resume)


def show_plan(options: StageOptions, command: str, plan: Sequence[dict[str, Any]]) -> None:
    """`--dry-run`: the resolved configuration and what would be made."""
    config = options.config.model_dump(mode="json")
    if options.as_json:
        print_json({"command": command, "dry_run": True, "config": config, "plan": list(plan)})
        return
    out = console()
    out.print("[bold]Config[/]")
    for section, values in config.items():
        out.print(f"\\[{section}]")
        for key, value in values.items():
            out.print(f"  {key} = {value}", markup=False)
    out.print("[bold]Plan[/] (dry run: nothing was done)")
    for step in plan:
        out.print(f"  {step['id']}: {step['plan']}", markup=False)


def note_left_out(options: StageOptions, left_out: Sequence["LeftOut"]) -> None:
    """Say which runs a report leaves out."""
    for each in left_out if not options.quiet else ():
        note(f"{each.id}: {each}")


def report_json(left_out: Sequence["LeftOut"], evidence: Path | None) -> dict[str, Any]:
    """What `--json` says of a report besides its artifact."""
    return {"left_out": [each._asdict() for each in left_out], "evidence": evidence}


def show_outcome(options: StageOptions, command: str, outcome: Outcome, **more: Any) -> None:
    """What a stage with one artifact did; `more` is for `--json`."""
    if options.as_json:
        print_json({"command": command, "status": "complete", **outcome.as_json(), **more})
    elif not options.quiet:
        out = console()
        took = f" in {duration(outcome.seconds)}" if outcome.seconds else ""
        out.print(f"[bold]{outcome.id}[/]: {_WORDS[outcome.did]}{took} → {escape(str(outcome.path))}")
        for key, value in scalars(outcome.summary).items():
            out.print(f"  {key}: {figure(value)}", markup=False)


def scalars(summary: dict[str, Any]) -> dict[str, Any]:
    """The figures of a summary that fit on a line."""
    return {key: value for key, value in summary.items() if not isinstance(value, (dict, list))}


def show_cells(options: StageOptions, command: str, outcomes: Sequence[Outcome]) -> None:
    """What happened to every cell of a matrix."""
    failed = [outcome for outcome in outcomes if outcome.did == "failed"]
    if options.as_json and not failed:
        print_json({"command": command, "status": "complete", "cells": [each.as_json() for each in outcomes]})
    elif not options.quiet and not options.as_json:
        console().print(results_table(outcomes))


def show_labels(options: Place, outcomes: Sequence[Outcome]) -> None:
    """What `relabel` made of each run."""
    if options.as_json:
        print_json({"command": "relabel", "status": "complete", "cells": [each.as_json() for each in outcomes]})
    elif not options.quiet:
        made = table("labels", "", "#transitions", "#mean reward used", "#estimation error [m]")
        for outcome in outcomes:
            figures = (outcome.summary.get(key) for key in ("transitions", "mean_reward_used", "estimation_error"))
            made.add_row(outcome.id, _WORDS[outcome.did], *map(figure, figures))
        console().print(made)


def results_table(outcomes: Sequence[Outcome]) -> Any:
    """Headline figures of runs."""
    made = table("run", "", "#episodes", "#final return", "#success", "#estimation error [m]")
    for outcome in outcomes:
        summary = outcome.summary
        figures = (figure(summary.get(key)) for key in ("episodes", "final_return"))
        success, error = summary.get("final_success_rate"), figure(summary.get("estimation_error"))
        rate = "–" if success is None else f"{success:.0%}"
        made.add_row(outcome.id.removeprefix("runs/"), _WORDS[outcome.did], *figures, rate, error)
    return made


def failure_message(outcomes: Sequence[Outcome]) -> str | None:
    """Names the cells that failed and why; None when none did."""
    failed = [each for each in outcomes if each.did == "failed"]
    if not failed:
        return None
    reasons = "; ".join(f"{each.id} ({each.summary.get('error', 'no reason')})" for each in failed)
    return f"{len(failed)} of {len(outcomes)} runs failed: {reasons}"
