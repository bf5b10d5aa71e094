"""`pipeline train-policy`."""

import click

from pipeline.commands.options import StageOptions, stage_options


@click.command(
    "train-policy",
    epilog="""\b
Example:
  pipeline train-policy --profile demo
  pipeline train-policy --name sweep --estimator demo --set policy.schemes='["dense"]' --set policy.seeds='[0, 1]'
""",
)
@stage_options
@click.option(
    "--estimator", metavar="NAME", help="Estimator in the loop; oracles alone need none.  [default: the same name]"
)
def train_policy(options: StageOptions, estimator: str | None) -> None:
    """Train a run or a matrix of runs, logging every transition.

    Writes runs/NAME/TASK-SCHEME-KINDDEG-seedN for every cell of tasks × schemes × misalignments × seeds in [policy].
    Complete cells are left alone; interrupted ones need --resume.
    """
    from pipeline.artifacts.names import check_name
    from pipeline.commands.results import failure_message, session, show_cells, show_plan
    from pipeline.steps import policy as step
    from pipeline.steps.perception import require_robot
    from pipeline.steps.session import planned
    from schemas.errors import MachineError

    work = session(options)
    wanted = estimator or (options.artifact_name if step.estimator_needed(work) else None)
    source = check_name(wanted.removeprefix("estimators/")) if wanted else None
    if source:
        require_robot(work, source)
    if options.dry_run:
        asked = step.requests(work, options.artifact_name, source)
        show_plan(options, "train-policy", [planned(work, request) for _, request in asked])
        return
    outcomes = step.train_policy([step.Matrix(work, options.artifact_name)], source)
    show_cells(options, "train-policy", outcomes)
    if message := failure_message(outcomes):
        raise MachineError(message)
