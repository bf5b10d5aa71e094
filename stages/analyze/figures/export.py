"""Figures as files: SVG and PNG by vl-convert, which renders without a browser or a network."""

from io import BytesIO
from pathlib import Path
from typing import Any

import altair as alt
import vl_convert
from PIL import Image

from schemas.errors import ConfigError, unknown_choice
from schemas.files import write_bytes
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Figure

_PANEL = {"width": 270, "height": 210}  # pixels
_PNG_SCALE = 2.0
_VERSION = ".".join(alt.SCHEMA_VERSION.removeprefix("v").split(".")[:2])
SUFFIXES = (".png", ".svg")


def page_specification(figure: Figure) -> list[dict[str, Any]]:
    """The panels for the report: as wide as the page gives them, without title and legend, which the page draws."""
    return [panel.draw(True).properties(width="container", height=220).to_dict() for panel in figure.panels]


def file_specification(figure: Figure) -> dict[str, Any]:
    """All panels as one chart with titles and legend, on white."""
    panels = [panel.draw(False).properties(**_PANEL, title=panel.title) for panel in figure.panels]
    chart = alt.concat(*panels, columns=figure.columns).properties(title=figure.title)
    if not figure.shared_colour:
        chart = chart.resolve_scale(color="independent")
    return chart.to_dict() | {"config": theme.config(dark=False) | {"background": "#ffffff"}, "padding": 16}


def write(figure: Figure, directory: Path) -> None:
    """Write `directory`/ID.svg and ID.png."""
    write_both(_svg(figure), directory, figure.id, photographs=False)


def save(figure: Figure, path: Path) -> None:
    """Write one file: .svg or .png.

    Raises:
        ConfigError: another suffix.
    """
    if path.suffix == ".svg":
        write_bytes(_svg(figure).encode(), path)
    elif path.suffix == ".png":
        write_bytes(vl_convert.svg_to_png(_svg(figure), scale=_PNG_SCALE), path)
    else:
        raise ConfigError(unknown_choice("suffix of a figure", path.suffix, SUFFIXES))


def _svg(figure: Figure) -> str:
    return str(vl_convert.vegalite_to_svg(file_specification(figure), vl_version=_VERSION))


def write_both(svg: str, directory: Path, id: str, *, photographs: bool) -> None:
    """Write `directory`/ID.svg and the picture of it as ID.png, small enough to commit.

    A chart has few colours, and a palette of them; in a photograph a palette loses those of what is small.
    """
    write_bytes(svg.encode(), directory / f"{id}.svg")
    stream = BytesIO()
    with Image.open(BytesIO(vl_convert.svg_to_png(svg, scale=_PNG_SCALE))) as image:
        colours = image.convert("RGB")
        if not photographs:
            colours = colours.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        colours.save(stream, "PNG", optimize=True)
    write_bytes(stream.getvalue(), directory / f"{id}.png")
