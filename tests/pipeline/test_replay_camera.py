"""`pipeline replay --misalignment --camera`: the same episode, seen from another camera, by nobody."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from mcap.reader import make_reader

from pipeline.cli import cli
from schemas import mcap_topics
from schemas.entities import CUBE_EST
from schemas.manifest import read_manifest
from schemas.mcap_files import read_messages, read_metadata
from stages.replay.frames import run_camera
from stages.replay.logs import load_episode
from tests.replay.tiny_run import CELL, RUN_NAME, edit_manifest, make_run


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one short episode, orbit by 5°; no estimator is named that could look again."""
    made = make_run(tmp_path_factory.mktemp("camera"), episodes=1, steps=3)
    edit_manifest(made, config=read_manifest(made).config | {"estimator": None})
    return made


def replay(run_dir: Path, *arguments: object) -> Result:
    command = ["replay", f"{RUN_NAME}/{CELL}", "--episode", "0", *map(str, arguments)]
    return CliRunner().invoke(cli, [*command, "--data", str(run_dir.parents[2])])


def saved(run_dir: Path, save: Path, *options: object) -> dict[str, list[Any]]:
    """Messages of the exported episode by topic."""
    result = replay(run_dir, "--save", save, *options)
    assert result.exit_code == 0, result.output
    found: dict[str, list[Any]] = {}
    for topic, _, message in read_messages(save):
        found.setdefault(topic, []).append(message)
    return found


def pictures(messages: dict[str, list[Any]]) -> list[bytes]:
    return [message.data for message in messages[mcap_topics.CAMERA_IMAGE]]


def estimates(save: Path) -> list[bytes]:
    """Serialised messages of the estimate, which datasets do not have."""
    with save.open("rb") as file:
        return [message.data for _, _, message in make_reader(file).iter_messages(topics=[CUBE_EST])]


def camera(messages: dict[str, list[Any]]) -> tuple[np.ndarray, np.ndarray]:
    return mcap_topics.placement(messages[mcap_topics.TF][0], mcap_topics.CAMERA_FRAME)


def test_the_default_camera_is_the_runs(run_dir: Path, tmp_path: Path) -> None:
    default = saved(run_dir, tmp_path / "default.mcap")
    same = saved(run_dir, tmp_path / "same.mcap", "--misalignment-kind", "orbit", "--misalignment-deg", 5)
    pose = run_camera(load_episode(run_dir, "final", 0)).pose
    assert np.array_equal(camera(default)[0], pose.position)
    assert np.array_equal(camera(default)[1], pose.quaternion)
    assert pictures(default) == pictures(same)
    assert read_metadata(tmp_path / "default.mcap")["camera"] == "orbit 5°"


@pytest.mark.parametrize(
    "options",
    [
        ("--misalignment-deg", 0),
        ("--misalignment-kind", "pan"),
        ("--misalignment-kind", "pan", "--misalignment", 8),
        ("--camera", "fovy=60"),
        ("--camera", "position=0.7,0.1,1.4", "--camera", "target=0,0,0.8"),
    ],
)
def test_another_camera_sees_the_same_episode_otherwise(
    run_dir: Path, tmp_path: Path, options: tuple[object, ...]
) -> None:
    default, turned = saved(run_dir, tmp_path / "a.mcap"), saved(run_dir, tmp_path / "b.mcap", *options)
    assert len(pictures(turned)) == 4
    assert all(own != other for own, other in zip(pictures(default), pictures(turned), strict=True))
    for topic in (mcap_topics.CUBE_POSE, mcap_topics.SIM_STATE):
        assert default[topic] == turned[topic]
    assert len(estimates(tmp_path / "a.mcap")) == 3
    assert estimates(tmp_path / "a.mcap") == estimates(tmp_path / "b.mcap")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--misalignment-deg", "10"), "nothing is rendered without --save"),
        (("--misalignment-kind", "tilt"), "'tilt' is not one of 'pan', 'orbit'"),
        (("--misalignment-deg", "91"), "91"),
        (("--camera", "fovy", "--save", "{tmp}/x.mp4"), "the form is KEY=VALUE"),
        (("--camera", "zoom=2", "--save", "{tmp}/x.mp4"), "unknown camera setting 'zoom'; valid: fovy, image_size"),
        (("--camera", "fovy=500", "--save", "{tmp}/x.mp4"), "camera setting fovy: Input should be less than 120"),
    ],
)
def test_wrong_usage(run_dir: Path, tmp_path: Path, options: tuple[str, ...], said: str) -> None:
    result = replay(run_dir, *(option.format(tmp=tmp_path) for option in options))
    assert (result.exit_code, said in result.stderr) == (2, True), result.stderr
