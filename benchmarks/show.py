"""An outcome as people read it: tables on a terminal."""

from statistics import median

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.outcome import Outcome


def show(outcome: Outcome, console: Console) -> None:
    """Print targets, figures, parts with their limits, and notes."""
    console.print(f"\n[bold]{outcome.benchmark}[/bold]: {outcome.compares}")
    if outcome.targets:
        console.print(_targets(outcome))
    if outcome.rounds:
        console.print(_rounds(outcome))
    for name, value in (outcome.figures | outcome.bare_speeds).items():
        console.print(f"  {escape(name)}: {_number(value)}")
    if outcome.parts:
        console.print(_parts(outcome))
    if outcome.table:
        console.print(_further(outcome))
    for note in outcome.notes:
        console.print(f"  {escape(note)}")


def _targets(outcome: Outcome) -> Table:
    table = Table("", "measured", "target", "")
    for target in outcome.targets:
        sign = "≥" if target.at_least else "≤"
        verdict = "[green]met[/green]" if target.met else "[red]not met[/red]"
        measured, bound = (f"{_number(number)} {target.unit}" for number in (target.value, target.bound))
        table.add_row(target.name, measured, f"{sign} {bound}", verdict)
    return table


def _rounds(outcome: Outcome) -> Table:
    table = Table("rates", "median", "min", "max", "rounds")
    for name, rates in outcome.rounds.items():
        table.add_row(escape(name), *(_number(f(rates)) for f in (median, min, max)), str(len(rates)))
    return table


def _parts(outcome: Outcome) -> Table:
    table = Table(f"per {outcome.unit}", "ms", "limit ms", "of limit")
    for part in outcome.parts:
        share = f"{part.limit / part.milliseconds:.0%}" if part.limit and part.milliseconds else ""
        table.add_row(part.name, f"{part.milliseconds:.3f}", "" if part.limit is None else f"{part.limit:.3f}", share)
    if outcome.limit_ms is not None:
        table.add_row(f"limit on {outcome.cores} core(s)", "", f"{outcome.limit_ms:.3f}", "")
    return table


def _further(outcome: Outcome) -> Table:
    table = Table(*(escape(name) for name in outcome.table[0]))
    for row in outcome.table:
        table.add_row(*(_number(v) if isinstance(v, float) else str(v) for v in row.values()))
    return table


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 100 else f"{value:,.0f}"
