"""`pipeline export`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.commands.options import Place, place_options

if TYPE_CHECKING:
    from stages.replay.formats.export import Format


@click.command(
    epilog="""\b
Example:
  pipeline export runs/demo/reach-dense-orbit00-seed0 --format minari -o reach-dense
  pipeline export demo/reach-dense-orbit00-seed0 --format robomimic -o final.hdf5 --split final --images
  pipeline export datasets/demo --format lerobot -o frames --episodes 100
"""
)
@place_options
@click.argument("artifact")
@click.option("--format", "form", type=click.Choice(["lerobot", "robomimic", "minari"]), required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    metavar="PATH",
    help="What to write: a directory, for robomimic a file. It must not be there yet.",
)
@click.option(
    "--split",
    type=click.Choice(["all", "train", "eval", "final", "validation", "test"]),
    default="all",
    show_default=True,
    help="Episodes of a run: train, eval or final; of a dataset: train, validation or test.",
)
@click.option("--episodes", type=click.IntRange(min=1), metavar="N", help="The first N only.")
@click.option("--images/--no-images", default=None, help="With what the camera saw.  [default: of datasets only]")
def export(
    options: Place, artifact: str, form: "Format", output: Path, split: str, episodes: int | None, images: bool | None
) -> None:
    """Write a run or a dataset in the format of LeRobot, robomimic or Minari.

    ARTIFACT is runs/NAME/CELL, relabels/NAME/CELL or datasets/NAME. Of a run: what the policy saw, its actions and the
    reward TD3 was given; with --images every episode is simulated again before the run's camera, for robomimic in any
    case, which also keeps the simulator's states. Of a dataset: the kept frames, with joints, action and cube of the
    same moment. What is written is whole or absent.
    """
    from pipeline.artifacts.inputs import resolve
    from pipeline.output import console, print_json
    from pipeline.steps.export import Wish
    from pipeline.steps.export import export as write

    found = resolve(options.data, artifact, ("runs", "relabels", "datasets"))
    wish = Wish(form, None if split == "all" else split, episodes, images)
    written = write(options.store, found, wish, output, options.progress)
    if options.as_json:
        print_json(written)
    elif not options.quiet:
        text = f"episodes: {written['episodes']:,}, steps: {written['steps']:,} → {output}"
        console().print(text, markup=False)
