"""Groups of runs side by side: how they learnt and where they ended."""

from collections.abc import Callable, Sequence

import altair as alt

from stages.analyze.compare import Comparison
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Drawing, Figure, Panel, values
from stages.analyze.results import IDENTITY, SCHEMES, Group, Row


def comparison(compared: Comparison) -> Figure:
    """Learning curves with their spread over seeds, and final returns with their intervals; a row of panels a task."""
    tasks = list(dict.fromkeys(group.task for group in compared.groups))
    panels: list[Panel] = []
    for task in tasks:
        curves, ends = _curves(compared, task), _ends(compared, task)
        panels += [Panel(f"{task}: while training", _curves_panel(curves, compared.labels))] if curves else []
        panels += [Panel(f"{task}: where they ended", _ends_panel(ends, compared.labels))] if ends else []
    caption = (
        "Episode reward (dense, from the true state). Left: mean over seeds, band of one standard deviation. Right: "
        "mean over seeds with its bootstrap interval; small: the seeds."
    )
    rows = compared.curves.rows
    return Figure(
        "comparison", "Runs compared", caption, tuple(panels), "learning-curves", compared.curves.sql, rows, columns=2
    )


def _curves(compared: Comparison, task: str) -> list[Row]:
    label = {_key(group): label for label, group in zip(compared.labels, compared.groups, strict=True)}
    found = [
        row | {"label": label[tuple(row[key] for key in IDENTITY)]}
        for row in compared.curves.rows
        if row["task"] == task
    ]
    return [
        row | {"low": row["mean"] - (row["std"] or 0.0), "high": row["mean"] + (row["std"] or 0.0)} for row in found
    ]


def _key(group: Group) -> tuple[object, ...]:
    return tuple(getattr(group, key) for key in IDENTITY)


def _ends(compared: Comparison, task: str) -> list[Row]:
    return [
        {"label": label, "mean": group.returns.mean, "low": group.returns.low, "high": group.returns.high}
        | {"seeds": list(group.scores.returns.values())}
        for label, group in zip(compared.labels, compared.groups, strict=True)
        if group.task == task and group.returns
    ]


def _colour(labels: Sequence[str], legend: bool) -> alt.Color:
    """A scheme has its own colour where the schemes are what differs."""
    schemes = set(labels) <= set(SCHEMES)
    palette = [theme.COLOURS[label] for label in labels] if schemes else list(theme.SERIES + theme.MORE_SERIES)
    scale = alt.Scale(domain=list(labels), range=[palette[i % len(palette)] for i in range(len(labels))])
    below = alt.Legend(title=None, orient="bottom", columns=2, labelLimit=320, symbolOpacity=1)
    return alt.Color("label:N", scale=scale, legend=below if legend else None)


def _curves_panel(rows: list[Row], labels: Sequence[str]) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        del page
        x = alt.X("after_episode:Q", title="training episodes")
        base = alt.Chart(values(rows)).encode(x=x, color=_colour(labels, legend=True))
        y = alt.Y("mean:Q", title="episode reward", scale=alt.Scale(zero=True, nice=True))
        tooltip = ["label:N", "after_episode:Q", *(alt.Tooltip(f"{part}:Q", format=".1f") for part in ("mean", "std"))]
        return alt.layer(
            base.mark_area(opacity=0.16).encode(y=alt.Y("low:Q"), y2="high:Q"),
            base.mark_line(strokeWidth=2, point=alt.OverlayMarkDef(size=18)).encode(y=y, tooltip=[*tooltip, "seeds:Q"]),
        )

    return draw


def _ends_panel(rows: list[Row], labels: Sequence[str]) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        del page
        seeds = [{"label": row["label"], "return": value} for row in rows for value in row["seeds"]]
        y = alt.Y("label:N", sort=list(labels), title=None, axis=alt.Axis(labelLimit=220, domain=False, ticks=False))
        base = alt.Chart(values(rows)).encode(y=y, color=_colour(labels, legend=False))
        x = alt.X("mean:Q", title="episode reward", scale=alt.Scale(zero=True, nice=True))
        tooltip = ["label:N", *(alt.Tooltip(f"{part}:Q", format=".1f") for part in ("mean", "low", "high"))]
        points = alt.Chart(values(seeds)).encode(y=y, color=_colour(labels, legend=False))
        return alt.layer(
            base.mark_rule(strokeWidth=2).encode(x=alt.X("low:Q"), x2="high:Q"),
            points.mark_tick(thickness=1.5, size=12, opacity=0.7).encode(x="return:Q", tooltip=["label:N", "return:Q"]),
            base.mark_point(filled=True, size=80, opacity=1).encode(x=x, tooltip=tooltip),
        )

    return draw
