"""`pipeline replay`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from pipeline.commands.options import Place, place_options

if TYPE_CHECKING:
    from stages.replay.proof import ReplayResult
    from stages.replay.reestimate import Eye, WhatIf


@click.command(
    epilog="""\b
Example:
  pipeline replay demo/reach-dense-orbit00-seed0 --episode 3
  pipeline replay demo/reach-dense-orbit00-seed0 --episode 3 --save episode.mp4 --image-size 512
  pipeline replay demo/reach-dense-orbit00-seed0 --episode 3 --misalignment 10 --save turned.rrd
  pipeline replay demo/reach-dense-orbit00-seed0 --episode 3 --estimator other --camera fovy=50
  pipeline replay demo/reach-dense-orbit00-seed0 --failure
"""
)
@place_options
@click.argument("run")
@click.option("--episode", type=click.IntRange(min=0), help="Counted from 0 within its split.")
@click.option("--failure", is_flag=True, help="The episode in which the run failed, up to where it did.")
@click.option("--split", type=click.Choice(["train", "eval", "final"]), default="final", show_default=True)
@click.option("--save", type=click.Path(dir_okay=False, path_type=Path), help="Write it to FILE.rrd, .mcap or .mp4.")
@click.option(
    "--image-size", type=click.IntRange(32, 1024), help="Of saved frames [pixels].  [default: the estimator's]"
)
@click.option(
    "--misalignment-kind",
    type=click.Choice(["pan", "orbit"]),
    help="How the camera is turned.  [default: as the run's]",
)
@click.option(
    "--misalignment",
    "--misalignment-deg",
    "misalignment_deg",
    type=click.FloatRange(0, 90),
    metavar="DEG",
    help="By how much it is turned [degrees].  [default: as the run's]",
)
@click.option(
    "--camera",
    multiple=True,
    metavar="KEY=VALUE",
    help="Another camera: position, target (x,y,z [m]) or fovy [degrees]; repeatable.",
)
@click.option("--estimator", metavar="NAME", help="Estimate again by this one.  [default: the run's]")
def replay(
    options: Place,
    run: str,
    episode: int | None,
    failure: bool,
    split: str,
    save: Path | None,
    image_size: int | None,
    misalignment_kind: Literal["pan", "orbit"] | None,
    misalignment_deg: float | None,
    camera: tuple[str, ...],
    estimator: str | None,
) -> None:
    """Re-simulate a logged episode and prove it identical.

    Every logged quantity of the world is compared with the re-simulated one, and the final simulator state bit for
    bit. Exit code 3 when they differ.

    With --save the episode is rendered, from the run's camera or from another one. From another camera, or with
    --estimator, the cube's position is estimated again from what that camera sees, and the rewards that follow from it
    are computed again: what the same trajectory would have been worth.
    """
    from pipeline.artifacts.inputs import load_shown, resolve
    from pipeline.machine import require_gl, require_sim
    from schemas.errors import ConfigError

    if failure == (episode is not None):
        raise ConfigError("name an episode with --episode N, or the one in which the run failed with --failure")
    moved = bool(camera) or misalignment_kind is not None or misalignment_deg is not None
    run_id = resolve(options.data, run, ("runs",))
    used = load_shown(options.data, run_id).config.get("estimator")
    looks_again = estimator is not None or (moved and used is not None)
    if not save and not looks_again and (moved or image_size is not None):
        raise ConfigError("nothing is rendered without --save FILE: add it, or leave the camera's options out")
    path, by = options.store.path(run_id), used if estimator is None else estimator
    require_sim()
    from stages.replay.export import check_target, export_episode
    from stages.replay.frames import View
    from stages.replay.proof import replay as resimulate

    what_if = None
    if save or looks_again:
        if save:
            check_target(save)
        view = View(image_size, misalignment_kind, misalignment_deg, _camera(camera))
        require_gl()
        result, what_if = export_episode(
            path, split, episode, save, view=view, eye=_eye(options, str(by)) if looks_again else None
        )
    else:
        result = resimulate(path, split, episode)
        result.require_identical()
    _show(options, result, what_if, save)


def _show(options: Place, result: "ReplayResult", what_if: "WhatIf | None", save: Path | None) -> None:
    from pipeline.output import console, print_json

    if options.as_json:
        found = {"what_if": what_if.as_dict() if what_if else None, "saved": str(save) if save else None}
        print_json(result.as_dict() | found)
    elif not options.quiet:
        out = console()
        out.print(result.message(), markup=False)
        out.print(f"{result.steps_per_second:,.0f} steps/s" + (f" → {save}" if save else ""), markup=False)
        if what_if:
            out.print(what_if.message(), markup=False)


def _camera(settings: tuple[str, ...]) -> dict[str, Any]:
    """KEY=VALUE as fields of the camera: `fovy=50`, `position=0.6,0,1.5`."""
    from schemas.errors import ConfigError

    found: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key:
            raise ConfigError(f"--camera {setting}: the form is KEY=VALUE, as in fovy=50 or position=0.6,0,1.5")
        found[key] = text.split(",") if "," in text else text
    return found


def _eye(options: Place, name: str) -> "Eye":
    """The estimator, verified and loaded."""
    from pipeline.artifacts.inputs import load_complete, resolve
    from pipeline.steps.relabel import load_eye

    estimator_id = resolve(options.data, name, ("estimators",))
    load_complete(options.data, estimator_id)
    return load_eye(options.store.path(estimator_id))
