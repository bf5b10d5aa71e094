"""Figures about the estimator: paper's Fig. 1, and what turning the camera does to it."""

from collections.abc import Callable
from itertools import groupby

import altair as alt

from stages.analyze.behind import Links
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Drawing, Figure, Panel, centimetres, leading, values
from stages.analyze.paper import ESTIMATOR_ERROR
from stages.analyze.results import Row, misalignment


def estimator_epochs(links: Links, rows: list[Row], sql: str) -> Figure:
    """Paper's Fig. 1: error by epoch, one panel an estimator."""
    kept = [row for row in _shown(links, rows) if row["split"] in ("train", "validation")]
    panels = [Panel(name, _epochs_panel(list(part))) for name, part in groupby(kept, lambda row: row["estimator"])]
    caption = (
        "Mean Euclidean error of the estimated cube position after each epoch, on the frames it is trained on and on "
        "validation episodes. The dotted line is the paper's error after 500 epochs."
    )
    title = "Estimator error by epoch"
    return Figure("fig1-estimator", title, caption, tuple(panels), "estimator-epochs", sql, rows)


def _epochs_panel(rows: list[Row]) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        colour = alt.Color(
            "split:N",
            scale=alt.Scale(domain=["train", "validation"], range=list(theme.SERIES[:2])),
            legend=alt.Legend(title=None, orient="top", direction="horizontal"),
        )
        x = alt.X("epoch:Q", title="epoch", axis=alt.Axis(tickMinStep=1))
        y = alt.Y("error_cm:Q", title="mean error [cm]", scale=alt.Scale(zero=True))
        error = alt.Tooltip("error_cm:Q", format=".2f", title="mean error [cm]")

        def base(part: list[Row]) -> alt.Chart:
            data = values(part, error_cm=lambda row: centimetres(row["mean_error"]))
            return alt.Chart(data).encode(x=x, y=y, color=colour, tooltip=["split:N", "epoch:Q", error])

        few = len({row["epoch"] for row in rows}) <= 40
        points = leading(rows, page, lambda part: base(part).mark_circle(opacity=1)) if few else []
        return alt.layer(base(rows).mark_line(strokeWidth=2), *points, *_paper_line())

    return draw


def estimator_misalignment(links: Links, rows: list[Row], sql: str) -> Figure:
    """Error of the estimator by how the camera was turned."""
    shown = _shown(links, rows)
    panels = [
        Panel(name, _misalignment_panel(list(part))) for name, part in groupby(shown, lambda row: row["estimator"])
    ]
    caption = (
        "Error on test episodes, from the camera as calibrated and turned after training. Bars: mean; "
        "ticks: median (short) and 95th percentile (long). The dotted line is the paper's error without misalignment."
    )
    id = "estimator-misalignment"
    return Figure(id, "Estimator error by misalignment", caption, tuple(panels), id, sql, rows)


def _misalignment_panel(rows: list[Row]) -> Callable[[bool], Drawing]:
    ordered = sorted(rows, key=lambda row: (row["misalignment_deg"], row["misalignment_kind"]))
    labels = [misalignment(row["misalignment_kind"], row["misalignment_deg"]) for row in ordered]

    def draw(page: bool) -> Drawing:
        tooltip = [
            alt.Tooltip("camera:N"),
            *(alt.Tooltip(f"{part}_cm:Q", format=".2f", title=f"{part} [cm]") for part in ("mean", "median", "p95")),
            alt.Tooltip("frames:Q", format=","),
        ]
        x = alt.X("camera:N", sort=labels, title="camera turned by", axis=alt.Axis(labelAngle=0))
        base = alt.Chart(_by_camera(ordered)).encode(x=x, tooltip=tooltip)
        y = alt.Y("mean_cm:Q", title="error [cm]")

        def bars(part: list[Row]) -> alt.Chart:
            marks = alt.Chart(_by_camera(part)).mark_bar(color=theme.SERIES[0], width={"band": 0.55}, cornerRadiusEnd=2)
            return marks.encode(x=x, y=y, tooltip=tooltip)

        return alt.layer(
            *leading(ordered, page, bars),
            base.mark_tick(thickness=2, width={"band": 0.3}, color="#2b2357").encode(y="median_cm:Q"),
            base.mark_tick(thickness=2, width={"band": 0.55}, color=theme.COLOURS["oracle"]).encode(y="p95_cm:Q"),
            base.mark_text(dy=-8, style="value-label").encode(y="mean_cm:Q", text=alt.Text("mean_cm:Q", format=".1f")),
            *_paper_line(),
        )

    return draw


def _by_camera(rows: list[Row]) -> alt.InlineData:
    return values(
        rows,
        camera=lambda row: misalignment(row["misalignment_kind"], row["misalignment_deg"]),
        mean_cm=lambda row: centimetres(row["mean_error"]),
        median_cm=lambda row: centimetres(row["median_error"]),
        p95_cm=lambda row: centimetres(row["p95_error"]),
    )


def _shown(links: Links, rows: list[Row]) -> list[Row]:
    return [row | {"recording": links.of_estimator(row["estimator"])} for row in rows]


def _paper_line() -> list[alt.Chart]:
    data = alt.InlineData(values=[{"error_cm": centimetres(ESTIMATOR_ERROR), "label": "paper"}])
    base = alt.Chart(data).encode(y=alt.Y("error_cm:Q"))
    text = base.mark_text(align="left", dx=4, style="note").encode(x=alt.value("width"), text="label:N")
    return [base.mark_rule(strokeDash=[2, 3]), text]
