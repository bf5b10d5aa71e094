"""Blueprints are values: they build, and show what their question is about."""

import pytest
import rerun.blueprint as rrb

from rerun_blueprints.episode import episode_blueprint
from rerun_blueprints.perception import perception_blueprint
from schemas import entities


def views(part: object) -> list[rrb.View]:
    """All views below a container."""
    if isinstance(part, rrb.View):
        return [part]
    return [view for child in getattr(part, "contents", []) for view in views(child)]


def names(blueprint: rrb.Blueprint) -> list[str]:
    return [str(view.name) for view in views(blueprint.root_container)]


def test_a_runs_episode_has_scene_camera_rewards_errors_and_phase():
    assert names(episode_blueprint()) == [
        "Scene",
        "Phase and completion signals",
        "Camera: true cube green, estimated orange",
        "About",
        "Reward per step",
        "Distance and estimation error [m]",
    ]


def test_a_datasets_episode_has_joints_and_actions_instead():
    assert names(episode_blueprint(estimated=False, rewarded=False)) == [
        "Scene",
        "Action (normalised joint velocities)",
        "Camera: true cube green",
        "About",
        "Joint positions [rad]",
    ]


def test_perception_has_frame_errors_and_all_of_the_test_split():
    assert names(perception_blueprint()) == [
        "Test frame: true cube green, estimated orange",
        "Which frames",
        "Error of the frame [mm]",
        "All test frames: true position green, error red",
        "Test frames by error [mm]",
        "About",
    ]


@pytest.mark.parametrize("blueprint", [episode_blueprint(), episode_blueprint(rewarded=False), perception_blueprint()])
def test_blueprints_can_be_saved(blueprint: rrb.Blueprint, tmp_path):
    path = tmp_path / "layout.rbl"
    blueprint.save(entities.APPLICATION_ID, str(path))
    assert path.stat().st_size > 0
