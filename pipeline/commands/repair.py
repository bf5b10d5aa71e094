"""`pipeline repair`."""

from pathlib import Path

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline repair runs/demo/reach-dense-orbit00-seed0
  pipeline repair episode-000012.mcap -o whole.mcap
"""
)
@place_options
@click.argument("what", metavar="ARTIFACT|FILE.mcap")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="For FILE.mcap: what to write; it must not be there yet.  [default: FILE-repaired.mcap]",
)
@click.option("--dry-run", is_flag=True, help="For ARTIFACT: say what would be dropped; do nothing.")
def repair(options: Place, what: str, output: Path | None, dry_run: bool) -> None:
    """Keep what is whole of a damaged artifact or MCAP file.

    An artifact loses the files that are not what was written, a run all episodes from the first that is not whole. It
    is unfinished then: the command that made it makes the rest, with --resume. What was dropped is said.

    Of FILE.mcap every message up to the last whole one goes into a new file; FILE stays as it is. Chunks that are not
    what was written are dropped.
    """
    from pipeline.artifacts.inputs import resolve
    from pipeline.output import console, print_json
    from pipeline.steps import repair as steps
    from schemas.errors import ConfigError

    if what.endswith(".mcap"):
        if dry_run:
            raise ConfigError("--dry-run is for artifacts: a repaired FILE.mcap is another file")
        _file(options, Path(what), output)
        return
    if output is not None:
        raise ConfigError("-o is for FILE.mcap: an artifact is repaired in its place")
    found = steps.repair(options.store, resolve(options.data, what), dry_run)
    if options.as_json:
        print_json(found.as_json())
    elif not options.quiet:
        console().print(found.message(), markup=False, soft_wrap=True)


def _file(options: Place, file: Path, output: Path | None) -> None:
    from pipeline.output import console, print_json
    from schemas.errors import ArtifactError, ConfigError, MachineError
    from schemas.mcap_recovery import recover

    target = output or file.with_name(f"{file.stem}-repaired.mcap")
    if not file.is_file():
        raise ArtifactError(f"there is no file {file}")
    if target.exists():
        raise ConfigError(f"{target} is there already: remove it or name another file with -o")
    temporary = target.with_name(f".{target.name}.tmp")
    try:
        found = recover(file, temporary)
        temporary.replace(target)
    except OSError as error:
        raise MachineError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
    if options.as_json:
        print_json({**found.as_dict(), "repaired": str(target)})
    elif not options.quiet:
        console().print(f"{found.message()} → {target}", markup=False, soft_wrap=True)
