"""An estimator's test frames: where is it wrong, by how much, and what does it look like there?"""

import rerun.blueprint as rrb

from schemas import entities

_BACKGROUND = (24, 27, 34)
_EYE = rrb.EyeControls3D(
    kind=rrb.Eye3DKind.Orbital,
    position=(0.36, 0.0, 1.27),
    look_target=(0.01, 0.0, 0.8),
    eye_up=(0.0, 0.0, 1.0),
)


def perception_blueprint() -> rrb.Blueprint:
    """Frames from the worst to the best beside the whole test split seen from above."""
    frame = rrb.Vertical(_image(), _groups(), _errors(), row_shares=[3.4, 0.75, 1])
    everything = rrb.Vertical(_space(), rrb.Horizontal(_histogram(), _about()), row_shares=[1.5, 1])
    return rrb.Blueprint(
        rrb.Horizontal(frame, everything),
        rrb.TimePanel(state="collapsed", timeline=entities.RANK, fps=2.0, loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _image() -> rrb.View:
    return rrb.Spatial2DView(
        name="Test frame: true cube green, estimated orange",
        origin=entities.IMAGE,
        contents="$origin/**",
        background=_BACKGROUND,
    )


def _groups() -> rrb.View:
    return rrb.StateTimelineView(
        name="Which frames", origin=entities.FRAME_GROUP, time_view=rrb.TimeAxis(link="LinkToGlobal")
    )


def _errors() -> rrb.View:
    return rrb.TimeSeriesView(
        name="Error of the frame [mm]",
        origin=entities.FRAME_ERROR,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _space() -> rrb.View:
    paths = (entities.TABLE, entities.CUBE, entities.TEST)
    return rrb.Spatial3DView(
        name="All test frames: true position green, error red",
        origin="/",
        contents=[f"+ {path}/**" for path in paths],
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=_EYE,
        spatial_information=rrb.SpatialInformation(entities.WORLD, show_axes=False),
    )


def _histogram() -> rrb.View:
    legend = rrb.PlotLegend(visible=False)
    return rrb.BarChartView(name="Test frames by error [mm]", origin=entities.ERROR_HISTOGRAM, plot_legend=legend)


def _about() -> rrb.View:
    return rrb.TextDocumentView(name="About", origin=entities.DESCRIPTION)
