"""Recordings are read back: what a viewer will find in them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import Chunk, McapReader, RrdReader

from rerun_blueprints.episode import episode_blueprint
from schemas import entities
from schemas.errors import ArtifactError, ConfigError, PipelineError
from schemas.images import encode, encode_within
from stages.replay.dataset_recording import record_dataset_episode
from stages.replay.dataset_track import dataset_track
from stages.replay.frames import View, run_camera
from stages.replay.logs import load_episode
from stages.replay.mcap_recording import record_mcap
from stages.replay.recording import record_episode
from stages.replay.rollout import roll_out
from stages.replay.run_track import run_track
from stages.sim.camera import nominal_pose
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.renderer import link_meshes
from stages.sim.scene import build_scene
from tests.replay.test_replay_blueprints import views
from tests.replay.tiny_run import ESTIMATOR, edit_manifest, tamper

MakeRun = Callable[..., Path]


@pytest.fixture(scope="module")
def recording(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "episode.rrd"
    assert record_episode(run_dir, "final", 0, path).identical
    return path


def chunks(path: Path) -> dict[str, list[Chunk]]:
    found: dict[str, list[Chunk]] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(chunk.entity_path, []).append(chunk)
    return found


def times(path: Path, entity: str, timeline: str) -> list[int]:
    return [
        int(value)
        for chunk in chunks(path)[entity]
        if timeline in chunk.timeline_names
        for value in chunk.to_record_batch()[timeline].cast(pa.int64()).to_pylist()
    ]


def test_the_recording_carries_its_blueprint_and_application(recording: Path):
    reader = RrdReader(recording)
    assert [store.application_id for store in reader.recordings()] == [entities.APPLICATION_ID]
    assert [store.application_id for store in reader.blueprints()] == [entities.APPLICATION_ID]


@pytest.mark.parametrize(
    "entity",
    [
        entities.IMAGE,
        entities.IMAGE_CUBE_TRUE,
        entities.IMAGE_CUBE_EST,
        entities.CUBE_TRUE,
        entities.CUBE_EST,
        entities.CUBE_ERROR,
        entities.GRIPPER_POINT,
        entities.ACTION,
        entities.JOINTS,
        entities.DISTANCE_TRUE,
        entities.DISTANCE_EST,
        entities.ESTIMATION_ERROR,
        *(entities.reward(term) for term in entities.REWARD_TERMS),
    ],
)
def test_every_step_is_there_on_both_timelines(recording: Path, entity: str):
    assert sorted(times(recording, entity, entities.STEP)) == list(range(20))
    assert sorted(times(recording, entity, entities.SIM_TIME)) == [50_000_000 * (k + 1) for k in range(20)]


def test_every_view_of_the_blueprint_has_something_to_show(recording: Path):
    recorded = chunks(recording).keys()
    for view in views(episode_blueprint().root_container):
        shown = view.contents if isinstance(view.contents, list) else [view.contents]
        for expression in shown:
            path = expression.removeprefix("+ ").replace("$origin", view.origin).removesuffix("/**")
            assert any(entity.startswith(path) for entity in recorded), f"{view.name}: {expression}"


def test_table_camera_states_and_description_are_there(recording: Path):
    found = chunks(recording)
    wanted = {
        entities.TABLE,
        entities.CALIBRATION,
        entities.DESCRIPTION,
        entities.STATE_PHASE,
        entities.state("success"),
    }
    assert wanted <= found.keys()
    assert len(times(recording, entities.STATE_PHASE, entities.STEP)) == 2  # dense, then sparse


def test_every_link_with_a_mesh_has_a_transform_at_every_step(recording: Path):
    meshes = {path.split("/")[3] for path in chunks(recording) if path.startswith(f"{entities.LINKS}/")}
    frames = [
        frame[0]
        for chunk in chunks(recording)[entities.TRANSFORMS]
        for frame in chunk.to_record_batch()["Transform3D:child_frame"].to_pylist()
    ]
    assert len(meshes) >= 10  # seven links, hand, two fingers, mount
    assert set(frames) == meshes | {entities.CAMERA}
    assert all(frames.count(frame) == 20 for frame in set(frames))


def test_recordings_stay_small(recording: Path):
    assert recording.stat().st_size < 1_500_000


def test_a_run_without_estimates_shows_none(fresh_run: MakeRun, tmp_path: Path):
    run = fresh_run(episodes=1, steps=2)
    for column in ("cube_est_x", "cube_est_y", "cube_est_z", "distance_est", "estimation_error", "reward_dense_est"):
        for step in range(2):
            tamper(run, column, step, lambda _: None)
    record_episode(run, "final", 0, tmp_path / "e.rrd")
    found = chunks(tmp_path / "e.rrd").keys()
    assert entities.CUBE_TRUE in found
    assert not {entities.CUBE_EST, entities.IMAGE_CUBE_EST, entities.DISTANCE_EST} & found


def test_the_camera_is_the_estimators_misaligned_as_the_run_says(run_dir: Path):
    camera = run_camera(load_episode(run_dir, "final", 0))  # orbit by 5° about the target
    around = camera.pose.position - CameraConfig().target
    angle = np.degrees(np.arctan2(around[1], around[0]))
    assert angle == pytest.approx(5.0)
    assert camera.pose.position[2] == pytest.approx(CameraConfig().position[2])
    assert camera.intrinsics.size == 64
    assert run_camera(load_episode(run_dir, "final", 0), View(image_size=200)).intrinsics.size == 200


@pytest.mark.parametrize(("content", "said"), [(None, "is gone"), ("{}", "is damaged"), ("[", "is damaged")])
def test_an_estimator_that_is_gone_or_damaged(fresh_run: MakeRun, tmp_path: Path, content: str | None, said: str):
    run = fresh_run(episodes=1, steps=2)
    card = run.parents[2] / "estimators" / ESTIMATOR / "estimator.json"
    card.unlink() if content is None else card.write_text(content)
    with pytest.raises(ArtifactError, match=said):
        record_episode(run, "final", 0, tmp_path / "e.rrd")
    assert list(tmp_path.glob("*.rrd")) == []


def test_a_place_that_does_not_exist_is_wrong_usage_and_leaves_nothing(run_dir: Path, tmp_path: Path):
    with pytest.raises(ConfigError, match="there is no directory"):
        record_episode(run_dir, "final", 0, tmp_path / "nowhere" / "e.rrd")


def test_another_view_turns_the_camera_and_nothing_else(run_dir: Path):
    logged = load_episode(run_dir, "final", 0)
    own, turned = run_camera(logged), run_camera(logged, View(misalignment_deg=0.0))
    assert own.misalignment == "orbit 5°"
    assert turned.misalignment == "orbit 0°"
    assert np.array_equal(turned.pose.position, nominal_pose(CameraConfig()).position)
    panned = run_camera(logged, View(misalignment_kind="pan"))  # by the run's 5°
    assert np.array_equal(panned.pose.position, turned.pose.position)
    assert np.degrees(np.arccos((np.trace(panned.pose.rotation.T @ turned.pose.rotation) - 1) / 2)) == pytest.approx(5)
    assert own.config == turned.config == panned.config


def test_small_frames_are_kept_exactly_large_ones_compressed(run_dir: Path):
    logged = load_episode(run_dir, "final", 0)
    assert run_camera(logged, View(image_size=128)).image_format == "png"
    assert run_camera(logged, View(image_size=256)).image_format == "jpeg"


def test_links_come_in_the_order_of_the_scene_in_every_process(run_dir: Path, dataset_dir: Path):
    logged = load_episode(run_dir, "final", 0)
    order = list(dict.fromkeys(mesh.link for mesh in link_meshes(build_scene(WorldConfig()))))
    assert list(run_track(logged, roll_out(logged)).links) == order
    assert list(dataset_track(dataset_dir, 0).links) == order


def test_a_datasets_episode_is_shown_from_its_file(dataset_dir: Path, tmp_path: Path):
    path = tmp_path / "d.rrd"
    assert record_dataset_episode(dataset_dir, 0, path) == 21
    found = chunks(path).keys()
    assert {entities.IMAGE, entities.CUBE_TRUE, entities.IMAGE_CUBE_TRUE, entities.TABLE, entities.CALIBRATION} <= found
    assert not {entities.CUBE_EST, entities.reward("used"), entities.STATE_PHASE} & found
    assert sorted(times(path, entities.IMAGE, entities.STEP)) == list(range(21))
    assert sorted(times(path, entities.ACTION, entities.STEP)) == list(range(20))


def test_dataset_and_run_place_the_same_cube_at_the_same_pixels(dataset_dir: Path, recording: Path, tmp_path: Path):
    record_dataset_episode(dataset_dir, 0, tmp_path / "d.rrd")

    def last_line(path: Path) -> np.ndarray:
        rows = [c.to_record_batch() for c in chunks(path)[entities.IMAGE_CUBE_TRUE] if not c.is_static]
        return np.array(rows[-1]["LineStrips2D:strips"][-1].as_py())

    assert np.allclose(last_line(tmp_path / "d.rrd"), last_line(recording), atol=1e-3)


def test_an_episode_the_dataset_does_not_have(dataset_dir: Path, tmp_path: Path):
    with pytest.raises(ArtifactError, match=r"no episode 3 in .*; it has 1, from 0 to 0"):
        record_dataset_episode(dataset_dir, 3, tmp_path / "d.rrd")


def test_a_truncated_episode_file(dataset_dir: Path, tmp_path: Path):
    damaged = tmp_path / "d"
    (damaged / "episodes").mkdir(parents=True)
    (damaged / "manifest.json").write_text((dataset_dir / "manifest.json").read_text())
    whole = (dataset_dir / "episodes" / "episode-000000.mcap").read_bytes()
    (damaged / "episodes" / "episode-000000.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PipelineError, match="is damaged"):
        record_dataset_episode(damaged, 0, tmp_path / "d.rrd")


def test_the_file_of_another_episode(dataset_dir: Path, tmp_path: Path):
    swapped = tmp_path / "d"
    (swapped / "episodes").mkdir(parents=True)
    (swapped / "manifest.json").write_text((dataset_dir / "manifest.json").read_text())
    (swapped / "episodes" / "episode-000001.mcap").write_bytes(next((dataset_dir / "episodes").iterdir()).read_bytes())
    with pytest.raises(ArtifactError, match=r"episode-000001\.mcap is of episode 0: put it back"):
        record_dataset_episode(swapped, 1, tmp_path / "d.rrd")


def test_a_run_is_no_dataset(fresh_run: MakeRun, tmp_path: Path):
    run = fresh_run(episodes=1, steps=2)
    with pytest.raises(ArtifactError, match="not a dataset"):
        record_dataset_episode(run, 0, tmp_path / "d.rrd")
    edit_manifest(run, stage="collect")
    with pytest.raises(ArtifactError, match="it has none"):
        record_dataset_episode(run, 0, tmp_path / "d.rrd")


def test_entities_are_the_topics_and_frames_of_the_mcap_files(dataset_dir: Path):
    stream = McapReader(dataset_dir / "episodes" / "episode-000000.mcap").stream()
    frames: dict[str, str] = {}
    for chunk in stream:
        batch = chunk.to_record_batch()
        for name in ("CoordinateFrame:frame", "Pinhole:child_frame"):
            if name in batch.schema.names:
                frames[chunk.entity_path] = batch[name][0].as_py()[0]
    assert frames[entities.IMAGE] == entities.IMAGE_PLANE
    assert frames[entities.CALIBRATION] == entities.IMAGE_PLANE
    assert frames[entities.CUBE_TRUE] == entities.WORLD
    assert frames[entities.CUBE_EST] == entities.WORLD


def test_an_mcap_file_as_it_is_under_the_same_blueprint(dataset_dir: Path, tmp_path: Path) -> None:
    [file] = sorted((dataset_dir / "episodes").iterdir())[:1]
    assert record_mcap(file, tmp_path / "m.rrd") >= 7
    reader = RrdReader(str(tmp_path / "m.rrd"))
    chunks = [chunk for chunk in reader.stream() if chunk.entity_path == entities.IMAGE]
    assert max(chunk.num_rows for chunk in chunks) == 21
    assert "message_log_time" in {name for chunk in chunks for name in chunk.timeline_names}
    assert [entry.application_id for entry in reader.blueprints()] == ["dense2sparse"]
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(ArtifactError, match="cannot be read as MCAP"):
        record_mcap(torn, tmp_path / "n.rrd")
    assert not (tmp_path / "n.rrd").exists()


def test_a_recording_stays_small_at_any_size_of_image() -> None:
    rng = np.random.default_rng(0)
    smooth = np.linspace(0, 255, 1024)[:, None, None] * np.ones((1, 1024, 3))
    frames = [(0.9 * smooth + rng.normal(0, 4, smooth.shape)).clip(0, 255).astype(np.uint8) for _ in range(3)]
    large, small = encode_within(frames, "jpeg", 3_000_000), encode_within(frames, "jpeg", 300_000)
    assert sum(map(len, small)) <= 300_000 < sum(map(len, large)) <= 3_000_000
    assert encode_within(frames[:1], "png", 1) == [encode(frames[0], "png")]
