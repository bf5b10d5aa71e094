"""Blueprint for the question: which runs learn faster, and how sure is that?"""

from collections.abc import Sequence

import rerun.blueprint as rrb

from schemas.entities import TRAINING_EPISODE, curves


def comparison(panels: Sequence[str]) -> rrb.Blueprint:
    """Learning curves side by side, one plot for each of `panels`: what lies below `schemas.entities.curves(panel)`."""
    views = [
        rrb.TimeSeriesView(
            origin=curves(panel),
            name=panel,
            axis_y=rrb.ScalarAxis(zoom_lock=True),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
        )
        for panel in panels
    ]
    columns = 2 if len(views) == 4 else min(3, max(1, len(views)))
    return rrb.Blueprint(
        rrb.Grid(*views, grid_columns=columns, name="Learning curves"),
        rrb.TimePanel(timeline=TRAINING_EPISODE, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )
