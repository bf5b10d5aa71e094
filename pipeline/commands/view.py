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
  pipeline view data/datasets/demo/episodes/episode-000012.mcap
  pipeline view runs/demo
"""
)
@place_options
@click.argument("artifact", metavar="ARTIFACT...", nargs=-1, required=True)
@click.option("--episode", type=click.IntRange(min=0), default=0, show_default=True, help="Of a dataset or run.")
@click.option(
    "--split", type=click.Choice(["train", "eval", "final"]), default="final", show_default=True, help="Of a run."
)
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), help="Write FILE.rrd instead of opening a window."
)
def view(options: Place, artifact: tuple[str, ...], episode: int, split: str, save: Path | None) -> None:
    """Open an artifact in the Rerun viewer, or save it for later.

    A dataset, a run or a FILE.mcap shows one episode, an estimator its predictions, a report its learning curves;
    several runs, or runs/NAME for all of a matrix, show their learning curves together. The command ends when the
    window is closed; Ctrl-C closes it.
    """
    from pipeline.output import console, print_json
    from pipeline.recordings import checked_save

    name, record = _recorder(options, artifact, episode, split)
    shown = record(checked_save(save)) if save else _show(record)
    if warning := shown.get("warning"):
        click.echo(f"Warning: {warning}", err=True)
    if options.as_json:
        print_json({"artifact": name, **shown, "recording": str(save) if save else None})
    elif save and not options.quiet:
        console().print(f"{name} → {save}  (open with `rerun {save}`)", markup=False)


def _recorder(
    options: Place, artifact: tuple[str, ...], episode: int, split: str
) -> tuple[str, Callable[[Path], dict[str, Any]]]:
    """What is shown, and what writes its recording."""
    from pipeline.artifacts.inputs import load_shown, resolve
    from pipeline.recordings import record_artifact, record_comparison, record_file

    if len(artifact) > 1 or _is_matrix(artifact[0]):
        return ", ".join(artifact), lambda file: record_comparison(options.data, artifact, file)
    if artifact[0].endswith(".mcap"):
        return artifact[0], lambda file: record_file(options.store, Path(artifact[0]), file)
    artifact_id = resolve(options.data, artifact[0], ("runs", "datasets", "estimators", "reports"))
    load_shown(options.data, artifact_id)
    return artifact_id, lambda file: record_artifact(options.store, artifact_id, split, episode, file)


def _is_matrix(artifact: str) -> bool:
    """runs/NAME, without a cell."""
    head, *rest = artifact.strip("/").split("/")
    return head == "runs" and len(rest) == 1


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
