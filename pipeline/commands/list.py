"""`pipeline list`."""

from typing import Any

import click

from pipeline.commands.options import Place, place_options


@click.command(
    "list",
    epilog="""\b
Example:
  pipeline list
  pipeline list runs --json
""",
)
@place_options
@click.argument("kind", required=False, metavar="[KIND]")
def list_artifacts(options: Place, kind: str | None) -> None:
    """List the artifacts that are there.

    KIND is datasets, estimators, runs, relabels or reports.
    """
    from pipeline.artifacts.names import STAGE_OF
    from pipeline.output import console, note, print_json, table
    from schemas.errors import ConfigError, unknown_choice

    if kind and kind not in STAGE_OF:
        raise ConfigError(unknown_choice("kind of artifact", kind, STAGE_OF))
    found = [_row(options, each) for each in _ids(options, kind)]
    if options.as_json:
        print_json({"artifacts": found})
        return
    if not found:
        note(f"nothing under {options.data} yet: `pipeline run demo` makes the first artifacts")
        return
    made = table("artifact", "status", "made", "headline")
    for row in found:
        made.add_row(row["id"], _word(row), row["created_at"], headline(row["summary"]))
    console().print(made)


def _ids(options: Place, kind: str | None) -> list[str]:
    from pipeline.artifacts.names import STAGE_OF, existing_ids

    return [each for one in ([kind] if kind else STAGE_OF) for each in existing_ids(options.data, one)]


def _row(options: Place, artifact_id: str) -> dict[str, Any]:
    """One artifact; one that cannot be read is listed as damaged, it does not hide the others."""
    from pipeline.artifacts.inputs import load
    from pipeline.artifacts.lock import is_held
    from schemas.errors import PipelineError

    try:
        manifest = load(options.data, artifact_id)
    except PipelineError as error:
        summary = {"error": str(error)}
        return {"id": artifact_id, "status": "damaged", "created_at": "", "summary": summary, "being_written": False}
    kept = manifest.model_dump(mode="json", include={"id", "status", "created_at", "summary"})
    return {**kept, "being_written": is_held(options.data, artifact_id)}


def _word(row: dict[str, Any]) -> str:
    """A running artifact that nobody writes was interrupted."""
    return "interrupted" if row["status"] == "running" and not row["being_written"] else str(row["status"])


HEADLINES = ("error", "test_mean_error", "final_return", "final_success_rate", "episodes", "frames", "bytes", "runs")


def headline(summary: dict[str, Any]) -> str:
    """The figures to tell artifacts apart by."""
    from pipeline.units import figure, size

    shown = {key: summary[key] for key in HEADLINES if summary.get(key) is not None}
    return ", ".join(f"{key} {size(value) if key == 'bytes' else figure(value)}" for key, value in shown.items())
