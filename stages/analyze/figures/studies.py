"""What a study's settings make of the episode reward."""

from collections.abc import Callable, Sequence

import altair as alt

from stages.analyze.behind import Links
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Drawing, Figure, Panel, by_setting, leading
from stages.analyze.results import Row, schemes_of
from stages.analyze.studies import Study, Variant, flat


def study(links: Links, asked: Study, variants: Sequence[Variant], sql: str) -> Figure | None:
    """Mean and interval of every variant, one panel a task and misalignment; None where nothing has been evaluated."""
    rows = [
        row
        | {"label": each.label + (" (main)" if each.main else ""), "returns": each.group.returns}
        | {"recording": links.of_group(row)}
        for each, row in zip(variants, flat(variants), strict=True)
        if each.study == asked.name and each.group.returns
    ]
    if not rows:
        return None
    tasks = sorted({row["task"] for row in rows}, key=lambda task: (task != "reach", task))
    schemes = schemes_of(rows)
    panels = []
    for task in tasks:
        mine = [row | {"name": task} for row in rows if row["task"] == task]
        panels += [Panel(f"{task} · {title}", _panel(part, asked, schemes)) for title, part in by_setting(mine)]
    keys = ", ".join(key.split(".")[-1] for key in asked.keys)
    caption = (
        f"Episode reward of the trained policies by {keys}. Point: mean over seeds; line: its bootstrap interval; "
        "diamond: the main runs."
    )
    title = f"{asked.name.capitalize()}: {asked.question}"
    shown = [{key: value for key, value in row.items() if key not in ("returns", "recording")} for row in rows]
    return Figure(f"study-{asked.name}", title, caption, tuple(panels), "study-outcomes", sql, shown, legend=True)


def _panel(rows: list[Row], asked: Study, legend: list[str]) -> Callable[[bool], Drawing]:
    labels = list(dict.fromkeys(row["label"] for row in rows))
    schemes = list(dict.fromkeys(row["scheme"] for row in rows))

    def draw(page: bool) -> Drawing:
        title = ", ".join(key.split(".")[-1] for key in asked.keys)
        y = alt.Y("label:N", sort=labels, title=title, axis=alt.Axis(labelLimit=150, domain=False, ticks=False))

        def base(part: list[Row]) -> alt.Chart:
            chart = alt.Chart(_data(part)).encode(y=y, color=theme.scheme_colour([] if page else legend))
            return chart.encode(yOffset=alt.YOffset("scheme:N", sort=schemes)) if len(schemes) > 1 else chart

        def points(part: list[Row]) -> alt.Chart:
            return base(part).mark_point(filled=True, size=80, opacity=1).encode(x=x, shape=shape, tooltip=tooltip)

        tooltip = [
            *("label:N", "scheme:N"),
            *(alt.Tooltip(f"return_{part}:Q", format=".1f") for part in ("mean", "low", "high")),
            *("seeds:Q", "failed:Q"),
        ]
        x = alt.X(
            "return_mean:Q",
            title="episode reward",
            axis=alt.Axis(tickCount=5),
            scale=alt.Scale(zero=False, nice=True, padding=8),
        )
        shape = alt.Shape("main:N", scale=alt.Scale(domain=[False, True], range=["circle", "diamond"]), legend=None)
        return alt.layer(
            base(rows).mark_rule(strokeWidth=2).encode(x=alt.X("return_low:Q"), x2="return_high:Q"),
            *leading(rows, page, points),
        )

    return draw


def _data(rows: list[Row]) -> alt.InlineData:
    shown = ("label", "scheme", "main", "return_mean", "return_low", "return_high", "seeds", "failed", "recording")
    return alt.InlineData(values=[{key: row[key] for key in shown} for row in rows])
