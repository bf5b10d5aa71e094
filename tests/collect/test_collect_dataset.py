"""What is in a collected dataset, against the world it was collected from."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import McapReader

from schemas import mcap_topics, tables
from schemas.mcap_files import TOPICS, read_messages, read_metadata
from stages.sim.config import WorldConfig
from stages.sim.scene import build_scene
from stages.sim.world import World
from tests.collect.small_dataset import (
    CONFIG,
    DATASET,
    PLANS,
    bounding_box,
    cube_box,
    decode,
    episode_files,
    frames,
    hides_nothing,
    red_pixels,
)

STEP_NS = 50_000_000


def test_one_file_per_episode(dataset: Path) -> None:
    assert [path.name for path in episode_files(dataset)] == [f"episode-{i:06d}.mcap" for i in range(4)]


def test_messages_are_of_kept_frames_and_actions_of_every_step(dataset: Path) -> None:
    for path, plan in zip(episode_files(dataset), PLANS, strict=True):
        steps: dict[str, list[float]] = {topic: [] for topic in TOPICS}
        for topic, time_ns, _ in read_messages(path):
            steps[topic].append(time_ns / STEP_NS)
        kept = list(plan.kept_steps)
        assert len(kept) == 10
        assert steps.pop(mcap_topics.ACTION) == list(range(40))
        assert steps.pop(mcap_topics.SIM_STATE) == sorted({0, *kept})
        assert steps == dict.fromkeys(steps, kept)


def test_one_clock(dataset: Path) -> None:
    with episode_files(dataset)[0].open("rb") as file:
        for _, _, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            stamps = (
                [t.timestamp for t in decoded.transforms] if hasattr(decoded, "transforms") else [decoded.timestamp]
            )
            assert {stamp.seconds * 1_000_000_000 + stamp.nanos for stamp in stamps} == {message.log_time}
            assert message.publish_time == message.log_time
            assert message.log_time % STEP_NS == 0


def test_metadata_says_how_the_episode_came_about(dataset: Path) -> None:
    records = [read_metadata(path) for path in episode_files(dataset)]
    assert [record["task"] for record in records] == ["reach", "lift", "reach", "lift"]
    assert Counter(record["behaviour"] for record in records) == {"random": 2, "scripted": 2}
    assert sorted(record["split"] for record in records) == ["test", "train", "train", "validation"]
    assert {record["seed"] for record in records} == {"0"}
    assert len({record["config_sha256"] for record in records}) == 1
    assert set(json.loads(records[0]["versions"])) == {"mujoco", "robosuite", "numpy"}


def test_arms_start_where_the_plan_says_and_cubes_within_its_spread(dataset: Path) -> None:
    scene = build_scene(CONFIG.world)
    for path, plan in zip(episode_files(dataset), PLANS, strict=True):
        first = next(message for topic, _, message in read_messages(path) if topic == mcap_topics.SIM_STATE)
        qpos = np.array(first.qpos)
        assert (np.abs(qpos[scene.arm_qpos] - scene.rest_qpos).max() > 0.2) == plan.leaning
        assert np.abs(qpos[scene.cube_qpos : scene.cube_qpos + 2]).max() <= plan.spread * CONFIG.world.cube_half_range
    assert {plan.leaning for plan in PLANS} == {True, False}


def test_metadata_camera_displacement_is_that_of_the_transforms(dataset: Path) -> None:
    shifts = []
    for path in episode_files(dataset):
        shift = np.array(json.loads(read_metadata(path)["camera_translation"]))
        position, _ = mcap_topics.placement(frames(path)[0][mcap_topics.TF], mcap_topics.CAMERA_FRAME)
        np.testing.assert_allclose(position - CONFIG.camera.position, shift, atol=1e-12)
        assert np.abs(shift).max() <= CONFIG.collect.camera_translation
        assert np.abs(json.loads(read_metadata(path)["camera_rotation"])).max() <= CONFIG.collect.camera_rotation + 0.01
        shifts.append(tuple(shift))
    assert len(set(shifts)) == 4


def test_frames_table_is_what_the_files_say(dataset: Path) -> None:
    table = pq.read_table(dataset / "frames.parquet")
    assert table.schema.equals(tables.FRAMES)
    rows = table.to_pylist()
    assert [(row["episode"], row["step"]) for row in rows] == [
        (plan.episode, step) for plan in PLANS for step in plan.kept_steps
    ]
    messages = [found for path in episode_files(dataset) for found in frames(path)]
    for row, found in zip(rows, messages, strict=True):
        plan, cube = PLANS[row["episode"]], found[mcap_topics.CUBE_POSE].pose.position
        position, quaternion = mcap_topics.placement(found[mcap_topics.TF], "camera")
        assert (row["dataset"], row["file"], row["split"], row["behaviour"]) == (
            DATASET,
            f"episodes/episode-{row['episode']:06d}.mcap",
            plan.split,
            plan.behaviour,
        )
        assert row["time_ns"] == row["step"] * STEP_NS
        assert (row["cube_x"], row["cube_y"], row["cube_z"]) == (cube.x, cube.y, cube.z)
        assert [row[f"camera_{axis}"] for axis in "xyz"] == position.tolist()
        assert [row[f"camera_q{axis}"] for axis in "wxyz"] == quaternion.tolist()


def test_episodes_can_be_simulated_again_exactly(dataset: Path) -> None:
    for path in episode_files(dataset):
        messages = list(read_messages(path, mcap_topics.SIM_STATE, mcap_topics.ACTION))
        states = {m.step: m for topic, _, m in messages if topic == mcap_topics.SIM_STATE}
        actions = [np.array(m.values, np.float32) for topic, _, m in messages if topic == mcap_topics.ACTION]
        world = World(build_scene(WorldConfig()), read_metadata(path)["task"])
        world.reset(np.array(states[0].integration_state))
        for step, action in enumerate(actions):
            if step in states:
                assert world.integration_state().tolist() == list(states[step].integration_state)
                assert world.qpos_full().tolist() == list(states[step].qpos)
            world.step(action)


def test_cube_projects_onto_the_cube_in_the_image(dataset: Path) -> None:
    checked = 0
    for episode, path in enumerate(episode_files(dataset)):
        for messages in frames(path):
            if not hides_nothing(episode, messages):
                continue
            red = red_pixels(decode(messages[mcap_topics.CAMERA_IMAGE]))
            centre, box = cube_box(messages)
            assert np.abs(box - bounding_box(red)).max() < 1.5
            assert red[int(centre[1]), int(centre[0])]
            rows, columns = np.nonzero(red)
            assert np.linalg.norm(centre - [columns.mean() + 0.5, rows.mean() + 0.5]) < 2
            checked += 1
    assert checked >= 10


def test_transforms_hold_every_link_and_agree_with_the_pose(dataset: Path) -> None:
    messages = frames(episode_files(dataset)[0])[0]
    children = {transform.child_frame_id for transform in messages[mcap_topics.TF].transforms}
    assert {"camera", "cube", "gripper0_right_leftfinger"} | {f"robot0_link{i}" for i in range(8)} <= children
    pose = messages[mcap_topics.CUBE_POSE].pose
    position, quaternion = mcap_topics.placement(messages[mcap_topics.TF], "cube")
    assert position.tolist() == [pose.position.x, pose.position.y, pose.position.z]
    o = pose.orientation
    assert quaternion.tolist() == [o.w, o.x, o.y, o.z]


def test_joints_are_the_arms(dataset: Path) -> None:
    messages = frames(episode_files(dataset)[0])[-1]
    joints = messages[mcap_topics.ROBOT_JOINTS].joints
    assert [joint.name for joint in joints] == [f"robot0_joint{i}" for i in range(1, 8)]
    qpos = np.array(messages[mcap_topics.SIM_STATE].qpos)
    assert [joint.position for joint in joints] == qpos[build_scene(WorldConfig()).arm_qpos].tolist()
    assert any(joint.velocity != 0 for joint in joints)


@pytest.fixture(scope="module")
def rerun_columns(dataset: Path) -> dict[str, dict[str, list]]:
    """What Rerun makes of an episode: entity path → component → one value per message."""
    found: dict[str, dict[str, list]] = {}
    for chunk in McapReader(episode_files(dataset)[1]).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            found.setdefault(chunk.entity_path, {}).setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


def test_rerun_decodes_image_and_pinhole_in_one_tree(rerun_columns: dict[str, dict[str, list]]) -> None:
    image, pinhole, tf = (rerun_columns[topic] for topic in ("/camera/image", "/camera/calibration", "/tf"))
    assert image["EncodedImage:media_type"] == [["image/png"]] * 10
    assert pinhole["Pinhole:resolution"] == [[[128, 128]]] * 10
    assert image["CoordinateFrame:frame"] == pinhole["Pinhole:child_frame"]  # the picture hangs on the pinhole,
    assert pinhole["Pinhole:parent_frame"] == [["camera"]] * 10  # the pinhole on the camera,
    edges = set(zip(*(map(tuple, tf[f"Transform3D:{end}_frame"]) for end in ("parent", "child")), strict=True))
    assert (("world",), ("camera",)) in edges  # and the camera on the world
    assert {parent for parent, _ in edges} == {("world",)}


def test_rerun_decodes_the_cube_and_knows_the_other_topics(rerun_columns: dict[str, dict[str, list]]) -> None:
    assert set(TOPICS) <= set(rerun_columns)
    assert rerun_columns["/cube/pose"]["CoordinateFrame:frame"] == [["world"]] * 10
    assert len(rerun_columns["/cube/pose"]["InstancePoses3D:translations"]) == 10
    assert len(rerun_columns["/action"]["dense2sparse.Action:message"]) == 40


def test_mcap_reader_decodes_every_topic_from_the_file_alone(dataset: Path) -> None:
    with episode_files(dataset)[0].open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        names = {channel.topic: schema.name for schema, channel, _, _ in reader.iter_decoded_messages() if schema}
    assert names == {
        "/camera/image": "foxglove.CompressedImage",
        "/camera/calibration": "foxglove.CameraCalibration",
        "/tf": "foxglove.FrameTransforms",
        "/cube/pose": "foxglove.PoseInFrame",
        "/robot/joints": "foxglove.JointStates",
        "/action": "dense2sparse.Action",
        "/sim/state": "dense2sparse.SimState",
    }
