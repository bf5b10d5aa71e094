"""A replayed episode as MCAP and MP4, read back by those formats' own readers."""

import json
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from rerun.chunk import McapReader

from schemas import mcap_topics
from schemas.entities import CUBE_EST
from schemas.errors import ArtifactError, ConfigError
from schemas.mcap_files import read_messages, read_metadata
from stages.replay.export import export_episode
from stages.replay.logs import load_episode
from stages.replay.video import write_mp4
from tests.replay.tiny_run import tamper


@pytest.fixture(scope="module")
def mcap(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exports") / "e.mcap"
    assert export_episode(run_dir, "final", 1, path).result.identical
    return path


@pytest.mark.parametrize("suffix", [".rrd", ".mcap", ".mp4"])
def test_a_replay_that_differs_leaves_no_file(fresh_run: Callable[..., Path], tmp_path: Path, suffix: str) -> None:
    run = fresh_run(episodes=1, steps=4)
    tamper(run, "eef_x", 2, lambda x: x + 1)
    with pytest.raises(ArtifactError, match="eef differs, first at step 2") as error:
        export_episode(run, "final", 0, tmp_path / f"x{suffix}")
    assert error.value.details["first_different_step"] == 2
    assert not list(tmp_path.glob("x*"))


def test_mcap_has_every_state_and_the_logged_actions(run_dir: Path, mcap: Path):
    logged = load_episode(run_dir, "final", 1)
    found: dict[str, list[tuple[int, object]]] = {}
    for topic, time, message in read_messages(mcap):
        found.setdefault(topic, []).append((time, message))
    assert {topic: len(messages) for topic, messages in found.items()} == {
        mcap_topics.CAMERA_IMAGE: 21,
        mcap_topics.CAMERA_CALIBRATION: 21,
        mcap_topics.TF: 21,
        mcap_topics.CUBE_POSE: 21,
        mcap_topics.ROBOT_JOINTS: 21,
        mcap_topics.SIM_STATE: 21,
        mcap_topics.ACTION: 20,
    }
    assert [time for time, _ in found[mcap_topics.ACTION]] == [50_000_000 * step for step in range(20)]
    actions = np.array([message.values for _, message in found[mcap_topics.ACTION]], dtype=np.float32)
    assert np.array_equal(actions, logged.rows["action"])
    states = [np.array(message.integration_state) for _, message in found[mcap_topics.SIM_STATE]]
    assert np.array_equal(states[0], logged.initial_state)
    assert np.array_equal(states[-1], logged.final_state)


def test_mcap_says_what_it_is(mcap: Path):
    metadata = read_metadata(mcap)
    assert (metadata["episode"], metadata["steps"], metadata["scheme"]) == ("1", "20", "dense2sparse")
    assert json.loads(metadata["identical"]) is True


def test_rerun_decodes_the_mcap_with_the_estimate(mcap: Path):
    rows: dict[str, int] = {}
    for chunk in McapReader(mcap).stream():
        if not chunk.is_static:
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    assert rows[mcap_topics.CAMERA_IMAGE] == 21
    assert rows[mcap_topics.CUBE_POSE] == 21
    assert rows[CUBE_EST] == 20


def test_mp4_plays_at_the_speed_of_simulation(run_dir: Path, tmp_path: Path):
    path = tmp_path / "e.mp4"
    export_episode(run_dir, "final", 0, path)
    with av.open(str(path)) as video:
        stream = video.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert stream.average_rate == 20
    assert stream.codec_context.pix_fmt == "yuv420p"
    assert len(frames) == 21
    assert frames[0].shape == (512, 512, 3)


def test_mp4_shows_the_frames_it_was_given(tmp_path: Path):
    greys = [np.full((64, 64, 3), level, np.uint8) for level in (0, 128, 255)]
    write_mp4(greys, tmp_path / "greys.mp4")
    with av.open(str(tmp_path / "greys.mp4")) as video:
        levels = [frame.to_ndarray(format="rgb24").mean() for frame in video.decode(video=0)]
    assert np.allclose(levels, [0, 128, 255], atol=2)
    assert [path.name for path in tmp_path.iterdir()] == ["greys.mp4"]


def test_rrd_is_a_format_too(run_dir: Path, tmp_path: Path):
    export_episode(run_dir, "final", 0, tmp_path / "e.rrd")
    assert (tmp_path / "e.rrd").stat().st_size > 10_000


def test_an_unknown_ending_lists_the_known_ones(run_dir: Path, tmp_path: Path):
    with pytest.raises(ConfigError, match=r"unknown format '\.gif'; valid: \.mcap, \.mp4, \.rrd"):
        export_episode(run_dir, "final", 0, tmp_path / "e.gif")
