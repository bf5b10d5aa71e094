"""The numbers that the report begins with."""

from collections.abc import Mapping
from dataclasses import dataclass

from stages.analyze import paper
from stages.analyze.derived import Derived, estimator_errors
from stages.analyze.results import Answer, total
from stages.analyze.study import Selection


@dataclass(frozen=True)
class Tile:
    """A number above the page."""

    label: str
    value: str
    unit: str
    note: str


def tiles(selection: Selection, derived: Derived, answers: Mapping[str, Answer]) -> list[Tile]:
    """Runs, seeds, how much was logged, and the worst of the estimators."""
    made = []
    runs = selection.runs
    if runs:
        statuses = [run.manifest.status for run in runs]
        counts = [f"{statuses.count(s)} {s}" for s in ("complete", "running", "failed") if s in statuses]
        beside = len(selection.study_runs)
        note = ", ".join(counts) + (f"; {beside} more in the studies" if beside else "")
        made.append(Tile("Runs", str(len(runs)), "", note))
        seeds = sorted({len(group.seeds) for group in derived.groups})
        several = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]}–{seeds[-1]}"
        made.append(Tile("Seeds a group", several, "", f"{len(derived.groups)} groups; the paper has {paper.SEEDS}"))
        note = f"in {total(answers, 'volume', 'episodes'):,} episodes, every one queryable and replayable"
        made.append(Tile("Transitions logged", f"{total(answers, 'volume', 'transitions'):,}", "", note))
    if errors := estimator_errors(answers):
        which = f", the worst of {len(errors)} estimators" if len(errors) > 1 else ""
        note = f"mean on test episodes{which}; the paper has {100 * paper.ESTIMATOR_ERROR:.1f} cm"
        made.append(Tile("Estimator error", f"{100 * max(errors.values()):.2f}", "cm", note))
    return made
