"""`pipeline repair`."""

from pathlib import Path

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline repair episode-000012.mcap
  pipeline repair broken.mcap -o whole.mcap
"""
)
@place_options
@click.argument("file", metavar="FILE.mcap", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="What to write; it must not be there yet.  [default: FILE-repaired.mcap]",
)
def repair(options: Place, file: Path, output: Path | None) -> None:
    """Keep what is whole of a damaged MCAP file.

    Every message up to the last whole one goes into a new file, and what was dropped is said; FILE stays as it is.
    Chunks that are not what was written are dropped.
    """
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
        console().print(f"{found.message()} → {target}", markup=False)
