"""Figures as files: SVG and PNG by vl-convert, which renders without a browser or a network."""

from pathlib import Path
from typing import Any

import altair as alt
import vl_convert

from schemas.files import write_bytes
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Figure

_PANEL = {"width": 270, "height": 210}  # pixels
_COLUMNS = 3
_PNG_SCALE = 2.0


def page_specification(figure: Figure) -> list[dict[str, Any]]:
    """The panels for the report: as wide as the page gives them, without title and legend, which the page draws."""
    return [panel.draw(True).properties(width="container", height=220).to_dict() for panel in figure.panels]


def file_specification(figure: Figure) -> dict[str, Any]:
    """All panels as one chart with titles and legend, on white."""
    panels = [panel.draw(False).properties(**_PANEL, title=panel.title) for panel in figure.panels]
    chart = alt.concat(*panels, columns=_COLUMNS).properties(title=figure.title)
    return chart.to_dict() | {"config": theme.config(dark=False) | {"background": "#ffffff"}, "padding": 16}


def write(figure: Figure, directory: Path) -> None:
    """Write `directory`/ID.svg and ID.png."""
    specification = file_specification(figure)
    version = ".".join(alt.SCHEMA_VERSION.removeprefix("v").split(".")[:2])
    svg = vl_convert.vegalite_to_svg(specification, vl_version=version)
    png = vl_convert.svg_to_png(svg, scale=_PNG_SCALE)
    write_bytes(svg.encode(), directory / f"{figure.id}.svg")
    write_bytes(png, directory / f"{figure.id}.png")
