"""A comparison of runs as a file: a page, or the figure alone."""

from pathlib import Path

from schemas.errors import ConfigError, MachineError, unknown_choice
from schemas.files import write_bytes
from stages.analyze import page
from stages.analyze.compare import Comparison
from stages.analyze.figures import export
from stages.analyze.figures.compare import comparison

SUFFIXES = (".html", *export.SUFFIXES)


def save_comparison(compared: Comparison, path: Path) -> None:
    """Write .html, a page with its tables that opens offline, or the figure as .svg or .png.

    Raises:
        ConfigError: another suffix.
        MachineError: it cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise ConfigError(unknown_choice("suffix of a comparison", path.suffix, SUFFIXES))
    try:
        if path.suffix == ".html":
            write_bytes(_page(compared).encode(), path)
        else:
            export.save(comparison(compared), path)
    except OSError as error:
        raise MachineError(f"cannot write {path}: {error.strerror or error}") from error


def _page(compared: Comparison) -> str:
    drawing = comparison(compared)
    return page.render(
        "compare.html.j2",
        [drawing],
        title=", ".join(dict.fromkeys(group.name for group in compared.groups)),
        drawing=drawing,
        ends=list(zip(compared.labels, compared.groups, strict=True)),
        contests=compared.contests,
        settings=compared.settings,
        confidence=f"{100 * compared.confidence:g} %",
    )
