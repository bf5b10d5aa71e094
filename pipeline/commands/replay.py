"""`pipeline replay`."""

from pathlib import Path
from typing import Literal

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline replay demo/reach-dense2sparse-orbit00-seed0 --episode 3
  pipeline replay demo/reach-dense2sparse-orbit00-seed0 --episode 3 --save episode.mp4 --image-size 512
  pipeline replay demo/reach-dense2sparse-orbit00-seed0 --episode 3 --save turned.rrd --misalignment-deg 10
"""
)
@place_options
@click.argument("run")
@click.option("--episode", type=click.IntRange(min=0), required=True, help="Counted from 0 within its split.")
@click.option("--split", type=click.Choice(["train", "eval", "final"]), default="final", show_default=True)
@click.option("--save", type=click.Path(dir_okay=False, path_type=Path), help="Write it to FILE.rrd, .mcap or .mp4.")
@click.option(
    "--image-size", type=click.IntRange(32, 1024), help="Of saved frames [pixels].  [default: the estimator's]"
)
@click.option(
    "--misalignment-kind",
    type=click.Choice(["pan", "orbit"]),
    help="How the camera of saved frames is turned.  [default: as the run's]",
)
@click.option(
    "--misalignment-deg",
    type=click.FloatRange(0, 90),
    help="By how much it is turned [degrees].  [default: as the run's]",
)
def replay(
    options: Place,
    run: str,
    episode: int,
    split: str,
    save: Path | None,
    image_size: int | None,
    misalignment_kind: Literal["pan", "orbit"] | None,
    misalignment_deg: float | None,
) -> None:
    """Re-simulate a logged episode and prove it identical.

    Every logged quantity of the world is compared with the re-simulated one, and the final simulator state bit for
    bit. Exit code 3 when they differ.

    With --save the episode is rendered, from the camera the run had or from another one. The estimates shown stay
    those that were logged, which the run's camera gave: they are not made again from what another camera sees.
    """
    from pipeline.artifacts.inputs import load, resolve
    from pipeline.machine import require_gl, require_sim
    from pipeline.output import console, print_json
    from schemas.errors import ConfigError

    if not save and (image_size, misalignment_kind, misalignment_deg) != (None, None, None):
        raise ConfigError("nothing is rendered without --save FILE: add it, or leave the camera's options out")
    run_id = resolve(options.data, run, ("runs",))
    load(options.data, run_id)
    path = options.store.path(run_id)
    require_sim()
    from stages.replay.export import check_target, export_episode
    from stages.replay.frames import View
    from stages.replay.proof import replay as resimulate

    if save:
        check_target(save)
        require_gl()
        view = View(image_size, misalignment_kind, misalignment_deg)
        result = export_episode(path, split, episode, save, view=view)
    else:
        result = resimulate(path, split, episode)
    result.require_identical()
    if options.as_json:
        print_json({**result.as_dict(), "saved": str(save) if save else None})
    elif not options.quiet:
        out = console()
        out.print(result.message())
        out.print(f"{result.steps_per_second:,.0f} steps/s" + (f" → {save}" if save else ""))
