"""`pipeline analyze`."""

import click

from pipeline.commands.options import StageOptions, stage_options


@click.command(
    epilog="""\b
Example:
  pipeline analyze --profile demo
  pipeline analyze --name comparison --runs demo --runs laptop --estimators laptop
"""
)
@stage_options
@click.option("--runs", multiple=True, metavar="NAME", help="Runs to report on, NAME or NAME/CELL; repeatable.")
@click.option("--estimators", multiple=True, metavar="NAME", help="Estimators to report on; repeatable.")
def analyze(options: StageOptions, runs: tuple[str, ...], estimators: tuple[str, ...]) -> None:
    """Query the logs; write an HTML report, figures and recordings.

    Writes reports/NAME. Without --runs and --estimators: on everything that is finished. A report whose inputs have
    changed is made anew.
    """
    from pipeline.commands.results import session, show_outcome, show_plan
    from pipeline.steps import analyze as step
    from pipeline.steps.session import planned

    work = session(options)
    if options.dry_run:
        ids = step.inputs(work, runs, estimators)
        show_plan(options, "analyze", [planned(work, step.request(work, options.artifact_name, ids))])
        return
    show_outcome(options, "analyze", step.analyze(work, options.artifact_name, runs, estimators))
