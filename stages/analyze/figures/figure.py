"""What a figure is, and what all figures share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

import altair as alt

from stages.analyze.results import Row, misalignment

Drawing = alt.LayerChart | alt.FacetChart  # what alt.layer may return


@dataclass(frozen=True)
class Panel:
    """One chart. `draw(page)`: for the report with hover, or (False) as a still with its own legend."""

    title: str
    draw: Callable[[bool], Drawing]


@dataclass(frozen=True)
class Figure:
    """Panels side by side under one caption, the question they answer, and its rows."""

    id: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    question: str  # name of the answer that `rows` are, or are part of
    sql: str
    rows: list[Row]
    legend: bool = False  # schemes: one legend above all panels
    columns: int = 3
    shared_colour: bool = True  # one colour scale and legend for all panels of the still


def by_setting(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Rows by (study, misalignment), with a title that names the study only where there are several."""
    names = {row["name"] for row in rows}
    ordered = sorted(rows, key=setting)
    parts = [(key, list(part)) for key, part in groupby(ordered, setting)]
    return [
        (misalignment(kind, deg) + (f" · {name}" if len(names) > 1 else ""), part) for (name, kind, deg), part in parts
    ]


def setting(row: Row) -> tuple[str, str, float]:
    """What the rows of one panel share: study, kind and degrees of the misalignment."""
    return row["name"], row["misalignment_kind"], row["misalignment_deg"]


def values(rows: Sequence[Row], **computed: Callable[[Row], object]) -> alt.InlineData:
    """Rows as chart data, with computed columns added."""
    return alt.InlineData(values=[row | {name: column(row) for name, column in computed.items()} for row in rows])


def leading(rows: list[Row], page: bool, draw: Callable[[list[Row]], alt.Chart]) -> list[alt.Chart]:
    """Marks of the rows, where a row has a `recording` as links to it; a still has no links.

    They are layers of their own: an address that is null would be one named null.
    """
    led = [row for row in rows if page and row.get("recording")]
    others = [row for row in rows if not (page and row.get("recording"))]
    drawn = [draw(others)] if others else []
    if led:
        marks = draw(led)
        drawn.append(marks.encode(href="recording:N", tooltip=[*marks.encoding.tooltip, "recording:N"]))
    return drawn


def centimetres(metres: float | None) -> float | None:
    """[m] → [cm]; what was not measured stays so."""
    return None if metres is None else 100.0 * metres
