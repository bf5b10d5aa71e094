"""Where on the table the estimate is wrong, what that does to the reward, and what it costs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import altair as alt

from stages.analyze.behind import Links
from stages.analyze.figures.figure import Drawing, Figure, Panel, by_setting, centimetres, leading, values
from stages.analyze.results import LEARN_FROM_ESTIMATES, SCHEMES, Row


@dataclass(frozen=True)
class _Quantity:
    column: str
    title: str
    unit: str
    format: str
    scale: float = 1.0

    @property
    def label(self) -> str:
        """With its unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


_QUANTITIES = (
    _Quantity("estimation_error", "estimation error", "cm", ".1f", 100.0),
    _Quantity("reward_error", "|reward error| per step", "", ".3f"),
    _Quantity("lost_return", "lost return", "", ".0f"),
)


def regions(links: Links, task: str, rows: list[Row], sql: str) -> Figure | None:
    """Maps of the table, one row a misalignment and scheme; None where no scheme that learns from estimates ran."""
    shown = [row | {"recording": links.of_region(row)} for row in rows if row["scheme"] in LEARN_FROM_ESTIMATES]
    quantities = [each for each in _QUANTITIES if any(row[each.column] is not None for row in shown)]
    if not shown or not quantities:
        return None
    panels = []
    for title, part in by_setting(shown):
        for scheme in (scheme for scheme in SCHEMES if any(row["scheme"] == scheme for row in part)):
            mine = [row for row in part if row["scheme"] == scheme]
            panels += [Panel(f"{title} · {scheme}: {each.label}", _map(mine, each, shown)) for each in quantities]
    caption = (
        "Final episodes by where the cube starts; the table is seen from above, the robot stands on its left (−x). "
        "Columns: mean error of the estimate; mean absolute error of the dense reward; return lost against the oracle "
        "that starts from the same state. One colour scale a column. In the report a region leads "
        "to its episode with the worst estimate where that is recorded."
    )
    title = f"{task.capitalize()}: error and loss by region of the table"
    id, columns = f"regions-{task}", len(quantities)
    return Figure(id, title, caption, tuple(panels), "regions", sql, rows, columns=columns, shared_colour=False)


def _map(rows: list[Row], quantity: _Quantity, every: Sequence[Row]) -> Callable[[bool], Drawing]:
    known = [quantity.scale * row[quantity.column] for row in every if row[quantity.column] is not None]
    domain = [min(0.0, *known), max(known)]

    def draw(page: bool) -> Drawing:
        colour = alt.Color(
            "value:Q",
            scale=alt.Scale(scheme="viridis", domain=domain, nice=False),
            legend=alt.Legend(title=quantity.unit or None, orient="right", gradientLength=120),
        )
        axis = alt.Axis(tickCount=4, labelFlush=False, grid=False)
        edges = [centimetres(edge) for edge in _edges(every)]
        counted = "compared:Q" if quantity.column == "lost_return" else "episodes:Q"
        tooltip = [
            alt.Tooltip("value:Q", format=quantity.format, title=quantity.label),
            alt.Tooltip(counted, format=",", title="episodes"),
            alt.Tooltip("worst:N", title="worst estimate"),
        ]
        x = alt.X("left:Q", title="x [cm]", axis=axis, scale=alt.Scale(domain=edges, nice=False))
        y = alt.Y("bottom:Q", title="y [cm]", axis=axis, scale=alt.Scale(domain=edges, nice=False))

        def cells(part: list[Row]) -> alt.Chart:
            marks = alt.Chart(_cells(part, quantity)).mark_rect(stroke="white", strokeWidth=0.5)
            return marks.encode(x=x, x2="right:Q", y=y, y2="top:Q", color=colour, tooltip=tooltip)

        return alt.layer(*leading(rows, page, cells))

    return draw


def _cells(rows: list[Row], quantity: _Quantity) -> alt.InlineData:
    return values(
        rows,
        value=lambda row: None if row[quantity.column] is None else quantity.scale * row[quantity.column],
        worst=lambda row: f"{row['worst_run']}, final episode {row['worst_episode']}",
        left=lambda row: centimetres(row["x"] - row["width"] / 2),
        right=lambda row: centimetres(row["x"] + row["width"] / 2),
        bottom=lambda row: centimetres(row["y"] - row["width"] / 2),
        top=lambda row: centimetres(row["y"] + row["width"] / 2),
    )


def _edges(rows: Sequence[Row]) -> tuple[float, float]:
    """Of the part of the table where the cube starts [m]; it is square, around the table's centre."""
    half = 2.5 * max(row["width"] for row in rows)
    return -half, half
