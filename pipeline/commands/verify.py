"""`pipeline verify`."""

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline verify
  pipeline verify datasets/demo runs/demo/reach-dense-orbit00-seed0
"""
)
@place_options
@click.argument("artifacts", nargs=-1, metavar="[ARTIFACT]...")
def verify(options: Place, artifacts: tuple[str, ...]) -> None:
    """Check that artifacts are what was written.

    Every file is compared with the hash in its manifest. Without ARTIFACT all that are there. Exit code 3 where a file
    is missing, cut off or changed. Inputs that have been made again since are remarked on; they are no damage.
    """
    from dataclasses import asdict

    from pipeline.artifacts.inputs import resolve
    from pipeline.artifacts.names import STAGE_OF, existing_ids
    from pipeline.artifacts.verify import verify as verdicts
    from pipeline.output import console, note, print_json, table
    from pipeline.units import size
    from schemas.errors import ArtifactError

    ids = [resolve(options.data, each) for each in artifacts]
    ids = ids or [each for kind in STAGE_OF for each in existing_ids(options.data, kind)]
    found = list(verdicts(options.data, ids, options.progress))
    damaged = [each for each in found if not each.is_sound]
    if options.as_json and not damaged:
        print_json({"artifacts": [asdict(each) for each in found]})
    elif not options.as_json and not options.quiet:
        if not found:
            note(f"nothing under {options.data} yet: `pipeline run demo` makes the first artifacts")
        made = table("artifact", "status", "#files", "#size", "found")
        for each in found:
            said = "; ".join((*each.problems, *each.remarks)) or ("not finished" if each.status == "running" else "ok")
            made.add_row(each.id, each.status, f"{each.files:,}", size(each.bytes), said)
        if found:
            console().print(made)
    if damaged:
        error = ArtifactError(
            f"{len(damaged)} of {len(found)} artifacts are damaged, first {damaged[0].id}: {damaged[0].problems[0]}; "
            "`pipeline repair` keeps what is whole, or make them again"
        )
        error.details = {"artifacts": [asdict(each) for each in found]}
        raise error
