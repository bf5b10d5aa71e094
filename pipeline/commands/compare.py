"""`pipeline compare`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.commands.options import Place, place_options

if TYPE_CHECKING:
    from rich.table import Table

    from stages.analyze.compare import Comparison


@click.command(
    epilog="""\b
Example:
  pipeline compare demo
  pipeline compare laptop laptop-buffer-relabel --save compared.html
  pipeline compare demo/reach-dense-orbit00-seed0 demo/reach-dense2sparse-orbit00-seed0 --json
"""
)
@place_options
@click.argument("runs", nargs=-1, required=True)
@click.option(
    "--save",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Also write FILE.html, or its figure as .png or .svg.",
)
@click.option(
    "--confidence", type=click.FloatRange(0, 1, min_open=True, max_open=True), default=0.95, show_default=True
)
def compare(options: Place, runs: tuple[str, ...], save: Path | None, confidence: float) -> None:
    """Compare runs: where they ended, how sure a difference is, in which settings they differ.

    RUNS are NAMEs (all their cells) or NAME/CELL. Those of one NAME, task, misalignment and scheme are one group, its
    seeds; the first group of each task is what the others of that task are measured against, a failed run counting as a
    return of 0. Intervals are bootstrapped over seeds.
    """
    from pipeline.output import console, print_json
    from schemas.errors import ConfigError, unknown_choice
    from stages.analyze.compare import compare as compared_runs
    from stages.analyze.compare_page import SUFFIXES, save_comparison
    from stages.analyze.config import AnalyzeConfig

    if save and save.suffix not in SUFFIXES:
        raise ConfigError(unknown_choice("suffix of --save", save.suffix, SUFFIXES))
    if save and not save.parent.is_dir():
        raise ConfigError(f"--save {save}: there is no directory {save.parent}")
    compared = compared_runs(options.data, runs, AnalyzeConfig(confidence=confidence))
    if save:
        save_comparison(compared, save)
    if options.as_json:
        print_json({**compared.as_dict(), "saved": save})
    elif not options.quiet:
        for made in (_groups(compared, confidence), _contests(compared, confidence), _settings(compared)):
            if made.row_count:
                console().print(made, "")
        if save:
            console().print(f"→ {save}", markup=False)


def _groups(compared: "Comparison", confidence: float) -> "Table":
    from pipeline.output import table
    from stages.analyze.formats import figure, interval, iqm

    interval_of = f"#{100 * confidence:g} % interval"
    columns = ("group", "#seeds", "", "#episode reward", interval_of, "#IQM", "#success", "#steps to success")
    made = table(*columns, title="[bold]Where they ended[/]")
    for label, group in zip(compared.labels, compared.groups, strict=True):
        state = ", ".join(f"{n} {word}" for n, word in ((group.failed, "failed"), (group.running, "running")) if n)
        reward, success, steps = group.returns, group.success, group.steps_to_success
        made.add_row(
            label, str(len(group.seeds)), state,
            figure(reward.mean if reward else None), interval(reward), iqm(reward),
            figure(success.mean if success else None, 0, 100) + " %", figure(steps.mean if steps else None),
        )  # fmt: skip
    return made


def _contests(compared: "Comparison", confidence: float) -> "Table":
    from pipeline.output import table
    from stages.analyze.formats import figure, signed

    interval_of = f"#{100 * confidence:g} % interval"
    columns = ("group", "against", "#P(better)", interval_of, "#difference", interval_of)
    made = table(*columns, title="[bold]How sure a difference is[/]")
    for each in compared.contests:
        sure = "–" if each.low is None else f"{figure(each.low, 2)} to {figure(each.high, 2)}"
        spread = (
            "–" if each.difference_low is None else f"{signed(each.difference_low)} to {signed(each.difference_high)}"
        )
        made.add_row(each.group, each.baseline, figure(each.improvement, 2), sure, signed(each.difference), spread)
    return made


def _settings(compared: "Comparison") -> "Table":
    from pipeline.output import table

    made = table("setting", *compared.labels, title="[bold]Settings that differ[/]")
    for setting in compared.settings:
        made.add_row(setting.key, *setting.values)
    return made
