"""`pipeline train-perception`."""

from pathlib import Path

import click

from pipeline.commands.options import StageOptions, stage_options


@click.command(
    "train-perception",
    epilog="""\b
Example:
  pipeline train-perception --profile demo
  pipeline train-perception --name longer --dataset demo --set perception.epochs=40
""",
)
@stage_options
@click.option("--dataset", metavar="NAME", help="Dataset to learn from.  [default: the same name]")
@click.option(
    "--weights",
    type=click.Path(path_type=Path),
    help="Initial weights: safetensors with torchvision's keys of resnet34, such as ImageNet's.",
)
def train_perception(options: StageOptions, dataset: str | None, weights: Path | None) -> None:
    """Train the ResNet34 position estimator on a dataset.

    Writes estimators/NAME: weights, errors by epoch and on the test split under every misalignment.
    """
    from pipeline.artifacts.names import check_name
    from pipeline.commands.results import session, show_outcome, show_plan
    from pipeline.steps import perception as step
    from pipeline.steps.session import planned

    work = session(options)
    source = check_name((options.artifact_name if dataset is None else dataset).removeprefix("datasets/"))
    if options.dry_run:
        show_plan(
            options, "train-perception", [planned(work, step.request(work, options.artifact_name, source, weights))]
        )
        return
    show_outcome(options, "train-perception", step.train_perception(work, options.artifact_name, source, weights))
