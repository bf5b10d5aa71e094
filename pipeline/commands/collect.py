"""`pipeline collect`."""

import click

from pipeline.commands.options import StageOptions, stage_options


@click.command(
    epilog="""\b
Example:
  pipeline collect --profile demo
  pipeline collect --name aimed --policy demo/reach-dense-orbit00-seed0 --set collect.tasks='["reach"]'
"""
)
@stage_options
@click.option("--policy", metavar="RUN", help="Trained run whose policy acts instead of the scripted controllers.")
def collect(options: StageOptions, policy: str | None) -> None:
    """Run the robot, render the fixed camera, write MCAP.

    Writes datasets/NAME: one MCAP file per episode and frames.parquet.
    """
    from pipeline.artifacts.inputs import resolve
    from pipeline.commands.results import session, show_outcome, show_plan
    from pipeline.steps import collect as step
    from pipeline.steps.session import planned

    work = session(options)
    run = resolve(options.data, policy, ("runs",)) if policy is not None else None
    if options.dry_run:
        show_plan(options, "collect", [planned(work, step.request(work, options.artifact_name, run))])
        return
    show_outcome(options, "collect", step.collect(work, options.artifact_name, run))
