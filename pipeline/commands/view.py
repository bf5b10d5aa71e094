"""`pipeline view`."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline view runs/demo/reach-dense2sparse-orbit00-seed0 --episode 3
  pipeline view datasets/demo --episode 12 --save episode.rrd
"""
)
@place_options
@click.argument("artifact")
@click.option("--episode", type=click.IntRange(min=0), default=0, show_default=True, help="Of a dataset or run.")
@click.option(
    "--split", type=click.Choice(["train", "eval", "final"]), default="final", show_default=True, help="Of a run."
)
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), help="Write FILE.rrd instead of opening a window."
)
def view(options: Place, artifact: str, episode: int, split: str, save: Path | None) -> None:
    """Open an artifact in the Rerun viewer, or save it for later.

    A dataset or run shows one episode, an estimator its predictions, a report its learning curves. The command ends
    when the window is closed; Ctrl-C closes it.
    """
    from pipeline.artifacts.inputs import load, resolve
    from pipeline.output import console, print_json
    from pipeline.recordings import record_artifact, recording_path

    artifact_id = resolve(options.data, artifact)
    load(options.data, artifact_id)
    if save:
        shown = record_artifact(options.store, artifact_id, split, episode, recording_path(save))
    else:
        shown = _show(lambda file: record_artifact(options.store, artifact_id, split, episode, file))
    if options.as_json:
        print_json({"artifact": artifact_id, **shown, "recording": str(save) if save else None})
    elif save and not options.quiet:
        console().print(f"{artifact_id} → {save}  (open with `rerun {save}`)")


def _show(record: Callable[[Path], dict[str, Any]]) -> dict[str, Any]:
    """Write a recording aside and show it until the window is closed."""
    from stages.replay.viewer import open_viewer, require_display, stop_viewer

    require_display()
    with TemporaryDirectory(prefix="pipeline-view-") as directory:
        file = Path(directory) / "view.rrd"
        shown = record(file)
        process = open_viewer(file)
        try:
            process.wait()
        finally:
            stop_viewer(process)
    return shown
