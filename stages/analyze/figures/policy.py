"""Figures about the policies: paper's Figs. 4 and 5, and what the estimate does to the reward."""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from statistics import fmean, mean, stdev

import altair as alt

from stages.analyze.behind import Links
from stages.analyze.figures import theme
from stages.analyze.figures.figure import Drawing, Figure, Panel, by_setting, centimetres, leading, setting, values
from stages.analyze.results import SCHEMES, Row, misalignment, schemes_of

_PAPER = {"reach": "fig4-reach", "lift": "fig5-lift"}
"""Names of the figures that the paper has too, by task."""


def learning_curves(links: Links, task: str, rows: list[Row], switches: list[Row], sql: str) -> Figure:
    """Paper's Figs. 4 (a, c, e) and 5 (a): mean and standard deviation over seeds, one panel a misalignment."""
    shown = [row | {"recording": links.of_group(row)} for row in rows]
    reached = max((row["mean"] + (row["std"] or 0.0) for row in rows), default=0.0)
    draw = partial(_curves_panel, top=1.04 * reached, legend=schemes_of(rows))
    panels = [
        Panel(title, draw(part, [row for row in switches if setting(row) == setting(part[0])]))
        for title, part in by_setting(shown)
    ]
    caption = (
        "Episode reward (dense, from the true state, whatever the run trains on) of evaluations without exploration "
        "noise. Line: mean over seeds; band: one standard deviation; vertical line: the switch of dense2sparse. In the "
        "report a line ends in a point that leads to a recording of the trained policy's typical episode."
    )
    id, title = f"{_PAPER.get(task, task)}-curves", f"{task.capitalize()}: episode reward while training"
    return Figure(id, title, caption, tuple(panels), "learning-curves", sql, rows, legend=True)


def _curves_panel(rows: list[Row], switches: list[Row], top: float, legend: list[str]) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        data = values(
            rows,
            low=lambda row: None if row["std"] is None else max(0.0, row["mean"] - row["std"]),
            high=lambda row: None if row["std"] is None else row["mean"] + row["std"],
        )
        x = alt.X("after_episode:Q", title="training episodes", scale=alt.Scale(zero=True))
        base = alt.Chart(data).encode(x=x, color=theme.scheme_colour([] if page else legend))
        y = alt.Y("mean:Q", title="episode reward", scale=alt.Scale(domain=[0, top], nice=True))
        return alt.layer(
            base.mark_area(opacity=0.16).encode(y=alt.Y("low:Q"), y2="high:Q"),
            base.mark_line(strokeWidth=2, strokeJoin="round").encode(y=y, strokeDash=theme.scheme_dash()),
            *([_hover_points(base, y), *_ends(rows, x, y)] if page else []),
            *_switch_rule(switches),
        )

    return draw


def _hover_points(base: alt.Chart, y: alt.Y) -> alt.Chart:
    """The evaluations nearest to the pointer, with their numbers."""
    nearest = alt.selection_point(
        nearest=True, on="pointerover", clear="pointerout", fields=["after_episode"], empty=False
    )
    opacity = alt.condition(nearest, alt.value(1), alt.value(0))
    points = base.mark_point(filled=True, size=55).encode(
        y=y, shape=theme.scheme_shape(), opacity=opacity, tooltip=_evaluation()
    )
    return points.add_params(nearest)


def _ends(rows: list[Row], x: alt.X, y: alt.Y) -> list[alt.Chart]:
    """The last evaluation of every scheme that has a recording."""
    last = {row["scheme"]: row for row in sorted(rows, key=lambda row: row["after_episode"])}
    recorded = [row for row in last.values() if row["recording"]]

    def points(part: list[Row]) -> alt.Chart:
        colour, shape = theme.scheme_colour(), theme.scheme_shape()
        marks = alt.Chart(values(part)).mark_point(filled=True, size=60, opacity=1)
        return marks.encode(x=x, y=y, color=colour, shape=shape, tooltip=_evaluation())

    return leading(recorded, True, points)


def _evaluation() -> list[str | alt.Tooltip]:
    """What is said of the evaluation under the pointer."""
    return [
        "scheme:N",
        alt.Tooltip("after_episode:Q", title="training episodes"),
        alt.Tooltip("mean:Q", format=".1f"),
        alt.Tooltip("std:Q", format=".1f"),
        "seeds:Q",
    ]


def _switch_rule(switches: list[Row]) -> list[alt.Chart]:
    if not switches:
        return []
    data = alt.InlineData(values=[{"episode": row["switch_episode"], "label": "switch"} for row in switches])
    base = alt.Chart(data).encode(x="episode:Q")
    text = base.mark_text(align="left", dx=4, dy=6, style="note").encode(y=alt.value(0), text="label:N")
    return [base.mark_rule(strokeDash=[2, 3]), text]


def success(links: Links, task: str, rows: list[Row], sql: str) -> Figure:
    """Paper's Figs. 4 (b, d, f) and 5 (b): success rate of the trained policies, one panel a misalignment."""
    shown = [row | {"recording": links.of_run(row["run"])} for row in rows]
    panels = [Panel(title, _success_panel(part, schemes_of(rows))) for title, part in by_setting(shown)]
    caption = (
        "Share of episodes that succeed: in the final evaluation, or in the last one made where a run has no final "
        "evaluation yet. Bar: mean over seeds; line: one standard deviation; points: the seeds, in the report with a "
        "recording of an episode behind those that have one."
    )
    id, title = f"{_PAPER.get(task, task)}-success", f"{task.capitalize()}: success of the trained policies"
    return Figure(id, title, caption, tuple(panels), "outcomes", sql, rows, legend=True)


def _success_panel(rows: list[Row], legend: list[str]) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        axis = alt.Axis(labelAngle=0, labelExpr="datum.label == 'dense2sparse' ? ['dense2', 'sparse'] : datum.label")
        x = alt.X("scheme:N", sort=list(SCHEMES), title=None, axis=axis)
        base = alt.Chart(alt.InlineData(values=_success_bars(rows))).encode(x=x)
        colour = theme.scheme_colour([] if page else legend)
        scale = alt.Scale(domain=[0, 105], nice=False)
        y = alt.Y("mean:Q", title="success [%]", scale=scale, axis=alt.Axis(values=[0, 25, 50, 75, 100]))
        tooltip = ["scheme:N", *(alt.Tooltip(f"{part}:Q", format=".1f") for part in ("mean", "std")), "seeds:Q"]
        return alt.layer(
            base.mark_bar(width={"band": 0.62}, cornerRadiusEnd=2, opacity=0.7).encode(
                y=y, color=colour, tooltip=tooltip
            ),
            base.mark_rule(strokeWidth=1.5).encode(y=alt.Y("low:Q"), y2="high:Q"),
            *_seed_points(rows, x, colour, page),
        )

    return draw


def _success_bars(rows: list[Row]) -> list[Row]:
    """Mean and standard deviation [%] over the seeds of each scheme; the line ends where a rate does, at 0 and 100."""
    bars = []
    for scheme in dict.fromkeys(row["scheme"] for row in rows):
        rates = [100.0 * row["success_rate"] for row in rows if row["scheme"] == scheme]
        bar: Row = {"scheme": scheme, "seeds": len(rates), "mean": mean(rates)}
        if len(rates) > 1:
            spread = stdev(rates)
            ends = {"low": max(0.0, bar["mean"] - spread), "high": min(100.0, bar["mean"] + spread)}
            bar |= {"std": spread} | ends
        bars.append(bar)
    return bars


def _seed_points(rows: list[Row], x: alt.X, colour: alt.Color, page: bool) -> list[alt.Chart]:
    """A layer a seed, each a little beside the last, so that equal rates stay apart; on the page some are links."""
    seeds = sorted({row["seed"] for row in rows})
    gap = min(8.0, 32.0 / len(seeds))  # pixels
    layers = []
    for place, seed in enumerate(seeds):
        of_seed = [row for row in rows if row["seed"] == seed]
        offset = gap * (place - (len(seeds) - 1) / 2)
        layers += leading(of_seed, page, partial(_points, x=x, colour=colour, offset=offset))
    return layers


def _points(rows: list[Row], *, x: alt.X, colour: alt.Color, offset: float) -> alt.Chart:
    percent = alt.Tooltip("percent:Q", format=".1f", title="success [%]")
    return (
        alt.Chart(values(rows, percent=lambda row: 100.0 * row["success_rate"]))
        .mark_circle(size=32, opacity=1, stroke="white", strokeWidth=0.8, xOffset=offset)
        .encode(x=x, y=alt.Y("percent:Q"), color=colour, tooltip=["run:N", percent, "split:N", "episodes:Q"])
    )


def reward_error(links: Links, rows: list[Row], sql: str) -> Figure:
    """What the estimate does to the dense reward, one panel a task."""
    several = len({row["name"] for row in rows}) > 1
    together = _over_schemes(rows)
    top = max(row["error"] for row in together)
    shown = [row | {"recording": links.of_setting(row)} for row in together]
    panels = [
        Panel(f"{task} · {name}" if several else task, _error_panel(list(part), top))
        for (_, task, name), part in groupby(sorted(shown, key=_by_task), _by_task)
    ]
    caption = (
        "Mean absolute difference between the dense reward from the estimated and from the true cube position, by the "
        "true distance between gripper and cube. Near the cube the reward is steepest, so the same error costs most."
    )
    id = "reward-error"
    return Figure(id, "How wrong the dense reward is, by distance", caption, tuple(panels), id, sql, rows)


def _over_schemes(rows: list[Row]) -> list[Row]:
    """Means over all steps of a setting and a distance, whichever scheme's policy made them."""
    keys = ("name", "task", "misalignment_kind", "misalignment_deg", "distance")
    bins: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        bins.setdefault(tuple(row[key] for key in keys), []).append(row)
    return [dict(zip(keys, key, strict=True)) | _mean_of_steps(members) for key, members in bins.items()]


def _mean_of_steps(rows: list[Row]) -> Row:
    steps = [row["steps"] for row in rows]
    return {"steps": sum(steps)} | {
        quantity: fmean([row[quantity] for row in rows], weights=steps) for quantity in ("error", "bias")
    }


def _by_task(row: Row) -> tuple[bool, str, str]:
    return row["task"] != "reach", row["task"], row["name"]


def _error_panel(rows: list[Row], top: float) -> Callable[[bool], Drawing]:
    def draw(page: bool) -> Drawing:
        ordered = sorted(rows, key=lambda row: (row["misalignment_deg"], row["misalignment_kind"]))
        labels = list(dict.fromkeys(misalignment(row["misalignment_kind"], row["misalignment_deg"]) for row in ordered))
        colour = alt.Color(
            "camera:N",
            sort=labels,
            scale=alt.Scale(domain=labels, range=list(theme.SERIES)),
            legend=alt.Legend(title=None, orient="top", direction="horizontal"),
        )
        tooltip: list[str | alt.Tooltip] = [
            "camera:N",
            alt.Tooltip("distance_cm:Q", format=".0f", title="distance [cm]"),
            alt.Tooltip("error:Q", format=".3f"),
            alt.Tooltip("bias:Q", format="+.3f"),
            alt.Tooltip("steps:Q", format=","),
        ]
        x = alt.X("distance_cm:Q", title="true distance between gripper and cube [cm]")
        y = alt.Y("error:Q", title="|reward error|", scale=alt.Scale(domain=[0, top], nice=True))

        def base(part: list[Row]) -> alt.Chart:
            return alt.Chart(_by_distance(part)).encode(x=x, y=y, color=colour, tooltip=tooltip)

        points = leading(ordered, page, lambda part: base(part).mark_circle(size=28, opacity=1))
        return alt.layer(base(ordered).mark_line(strokeWidth=2), *points)

    return draw


def _by_distance(rows: list[Row]) -> alt.InlineData:
    return values(
        rows,
        camera=lambda row: misalignment(row["misalignment_kind"], row["misalignment_deg"]),
        distance_cm=lambda row: centimetres(row["distance"]),
    )
