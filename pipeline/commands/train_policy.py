"""`pipeline train-policy`."""

import click

from pipeline.commands.options import StageOptions, stage_options


@click.command(
    "train-policy",
    epilog="""\b
Example:
  pipeline train-policy --profile demo
  pipeline train-policy --name sweep --estimator demo --set policy.schemes='["dense"]' --set policy.seeds='[0, 1]'
  pipeline train-policy --name cloned --offline demo --set policy.td3.behaviour_cloning=2.5
""",
)
@stage_options
@click.option(
    "--estimator", metavar="NAME", help="Estimator in the loop; oracles alone need none.  [default: the same name]"
)
@click.option(
    "--offline",
    multiple=True,
    metavar="RUN",
    help="Learn from the transitions of this run (or relabels/…) alone; repeatable.",
)
def train_policy(options: StageOptions, estimator: str | None, offline: tuple[str, ...]) -> None:
    """Train a run or a matrix of runs, logging every transition.

    Writes runs/NAME/TASK-SCHEME-KINDDEG-seedN for every cell of tasks × schemes × misalignments × seeds in [policy].
    Complete cells are left alone; interrupted ones need --resume.

    With --offline nothing is tried out: TD3 (TD3+BC with policy.td3.behaviour_cloning) learns from the training
    transitions of the runs named, and is evaluated in their world. Tasks, schemes, misalignments, estimator and world
    are theirs; runs that differ only in the seed are one source. An episode is then as many updates as it has steps.
    """
    from pipeline.artifacts.names import check_name
    from pipeline.commands.results import failure_message, session, show_cells, show_plan
    from pipeline.steps import offline as from_logs
    from pipeline.steps import policy as step
    from pipeline.steps.perception import require_robot
    from pipeline.steps.session import planned
    from schemas.errors import ConfigError, MachineError

    work, name = session(options), options.artifact_name
    if offline:
        if estimator is not None:
            raise ConfigError("--offline: the estimator is the one of the runs; leave --estimator out")
        matrices, source = from_logs.matrices(work, name, offline)
    else:
        matrices = [step.Matrix(work, name)]
        wanted = (name if step.estimator_needed(work) else None) if estimator is None else estimator
        source = None if wanted is None else check_name(wanted.removeprefix("estimators/"))
        if source:
            require_robot(work, source)
    if options.dry_run:
        asked = [(matrix, request) for matrix in matrices for _, request in step.requests(matrix, source)]
        show_plan(options, "train-policy", [planned(matrix.session, request) for matrix, request in asked])
        return
    outcomes = step.train_policy(matrices, source)
    show_cells(options, "train-policy", outcomes)
    if message := failure_message(outcomes):
        raise MachineError(message)
