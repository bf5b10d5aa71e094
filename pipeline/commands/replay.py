"""`pipeline replay`."""

from pathlib import Path

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline replay demo/reach-dense2sparse-orbit00-seed0 --episode 3
  pipeline replay demo/reach-dense2sparse-orbit00-seed0 --episode 3 --save episode.mp4 --image-size 512
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
def replay(options: Place, run: str, episode: int, split: str, save: Path | None, image_size: int | None) -> None:
    """Re-simulate a logged episode and prove it identical.

    Every logged quantity of the world is compared with the re-simulated one, and the final simulator state bit for
    bit. Exit code 3 when they differ.
    """
    from pipeline.artifacts.inputs import load, resolve
    from pipeline.machine import require_gl, require_sim
    from pipeline.output import console, print_json

    run_id = resolve(options.data, run, ("runs",))
    load(options.data, run_id)
    path = options.store.path(run_id)
    require_sim()
    from stages.replay.export import check_target, export_episode
    from stages.replay.proof import replay as resimulate

    if save:
        check_target(save)
        require_gl()
        result = export_episode(path, split, episode, save, image_size=image_size)
    else:
        result = resimulate(path, split, episode)
    result.require_identical()
    if options.as_json:
        print_json({**result.as_dict(), "saved": str(save) if save else None})
    elif not options.quiet:
        out = console()
        out.print(result.message())
        out.print(f"{result.steps_per_second:,.0f} steps/s" + (f" → {save}" if save else ""))
