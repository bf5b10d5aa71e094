"""One episode: where is the cube, where does the estimate put it, and what does the reward make of that?"""

import rerun.blueprint as rrb

from schemas import entities

_BACKGROUND = (24, 27, 34)
_IN_SPACE = (entities.TABLE, entities.ROBOT, entities.CUBE, entities.GRIPPER, entities.CAMERA_ROOT)
_EYE = rrb.EyeControls3D(
    kind=rrb.Eye3DKind.Orbital,
    position=(0.9, -0.92, 1.42),
    look_target=(0.07, 0.0, 0.96),
    eye_up=(0.0, 0.0, 1.0),
)


def episode_blueprint(
    *,
    estimated: bool = True,
    rewarded: bool = True,
    best_reward: float = 1.0,
    plots: bool = True,
    timeline: str = entities.SIM_TIME,
) -> rrb.Blueprint:
    """Layout of one episode.

    Args:
        estimated: there is an estimate of the cube's position to compare with.
        rewarded: there are rewards and distances (a run); else joints and actions are shown (a dataset).
        best_reward: of one step, 1 in reach and 2.25 in lift.
        plots: there are scalars over time; a plain `.mcap` file has them as messages of its own kinds.
        timeline: the timeline to start on; `message_log_time` for a plain `.mcap` file.
    """
    below = [_states() if rewarded else _actions()] * plots
    beside = ([_rewards(best_reward), _distances(estimated)] if rewarded else [_joints()]) * plots
    space = rrb.Vertical(_scene(), *below, row_shares=[2.7] + [1.0] * len(below))
    side = rrb.Vertical(_camera(estimated), *beside, row_shares=[2.2] + [1.0] * len(beside))
    return rrb.Blueprint(
        rrb.Horizontal(space, side, column_shares=[1.55, 1]),
        rrb.TimePanel(state="collapsed", timeline=timeline, playback_speed=1.0, loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _scene() -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        name="Scene",
        origin="/",
        contents=[f"+ {path}/**" for path in _IN_SPACE],
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=_EYE,
        spatial_information=rrb.SpatialInformation(entities.WORLD, show_axes=False),
    )


def _camera(estimated: bool) -> rrb.Container:
    image = rrb.Spatial2DView(
        name="Camera: true cube green" + ", estimated orange" * estimated,
        origin=entities.IMAGE,
        contents="$origin/**",
        background=_BACKGROUND,
    )
    return rrb.Tabs(image, rrb.TextDocumentView(name="About", origin=entities.DESCRIPTION))


def _rewards(best: float) -> rrb.View:
    margin = 0.05 * best
    axis = rrb.ScalarAxis(range=(-margin, best + margin))
    return _plot("Reward per step", [f"{entities.REWARD}/**"], rrb.Corner2D.RightBottom, axis)


def _distances(estimated: bool) -> rrb.View:
    contents = [f"{entities.DISTANCE}/**"] + [entities.ESTIMATION_ERROR] * estimated
    name = "Distance and estimation error [m]" if estimated else "Distance [m]"
    return _plot(name, contents, rrb.Corner2D.RightTop)


def _joints() -> rrb.View:
    return _plot("Joint positions [rad]", [entities.JOINTS], rrb.Corner2D.RightTop)


def _actions() -> rrb.View:
    axis = rrb.ScalarAxis(range=(-1.05, 1.05))
    return _plot("Action (normalised joint velocities)", [entities.ACTION], rrb.Corner2D.RightTop, axis)


def _plot(name: str, contents: list[str], legend: rrb.Corner2D, axis: rrb.ScalarAxis | None = None) -> rrb.View:
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[f"+ {path}" for path in contents],
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=axis,
        plot_legend=rrb.PlotLegend(legend),
    )


def _states() -> rrb.View:
    return rrb.StateTimelineView(
        name="Phase and completion signals", origin=entities.STATE, time_view=rrb.TimeAxis(link="LinkToGlobal")
    )
