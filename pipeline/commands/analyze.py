"""`pipeline analyze`."""

from pathlib import Path

import click

from pipeline.commands.options import ACCUMULATE, EVIDENCE, StageOptions, stage_options


@click.command(
    epilog="""\b
Example:
  pipeline analyze --profile demo
  pipeline analyze --name comparison --runs demo --runs laptop --estimators laptop
  pipeline analyze --profile laptop --runs laptop --evidence results/laptop --accumulate
"""
)
@stage_options
@click.option("--runs", multiple=True, metavar="NAME", help="Runs to report on, NAME or NAME/CELL; repeatable.")
@click.option("--estimators", multiple=True, metavar="NAME", help="Estimators to report on; repeatable.")
@EVIDENCE
@ACCUMULATE
def analyze(
    options: StageOptions, runs: tuple[str, ...], estimators: tuple[str, ...], evidence: Path | None, accumulate: bool
) -> None:
    """Query the logs; write an HTML report, figures and recordings.

    Writes reports/NAME. Without --runs and --estimators: on everything that is finished. A report whose inputs have
    changed is made anew.

    Of a NAME only the finished runs count. Where none is finished, and of NAME/CELL, the report is on what is there:
    of a run that is being trained the whole episodes up to now. With one --runs NAME the report also answers the
    studies of the configuration whose runs lie beside it, NAME-STUDY-VALUE.

    With --accumulate, --evidence adds to an earlier evidence what is new, for studies whose runs are trained in several
    sittings or on several machines: all seeds of a task, scheme and misalignment in one. Estimators made anew by the
    same configuration are told apart.
    """
    from pipeline.commands.results import note_left_out, report_json, session, show_outcome, show_plan
    from pipeline.evidence import check_directory, copy_evidence, planned_copy
    from pipeline.steps import analyze as step
    from pipeline.steps.session import planned

    work = session(options)
    subject = step.subject(work, runs, estimators, base=_base(runs))
    check_directory(evidence, options.data, accumulate, [*subject.runs, *subject.studies.runs])
    if options.dry_run:
        plan = planned(work, step.request(work, options.artifact_name, subject))
        show_plan(
            options,
            "analyze",
            [*(each.planned() for each in subject.left_out), plan, *planned_copy(evidence, accumulate)],
        )
        return
    note_left_out(options, subject.left_out)
    outcome = step.analyze(work, options.artifact_name, subject)
    copy_evidence(outcome.path, evidence, accumulate)
    show_outcome(options, "analyze", outcome, **report_json(subject.left_out, evidence))


def _base(runs: tuple[str, ...]) -> str | None:
    """NAME of the one matrix beside which studies are looked for."""
    names = [name.removeprefix("runs/").strip("/") for name in runs]
    return names[0] if len(names) == 1 and "/" not in names[0] else None
