"""The columns that SPEC §4 and §5 promise, written out: a renamed or retyped one is a broken promise."""

import pyarrow as pa

from schemas import tables

WORD = pa.dictionary(pa.int32(), pa.string())

TRANSITIONS = {  # SPEC §5, with an observation of 24 numbers and an action of 7
    "run": WORD,
    "task": WORD,
    "scheme": WORD,
    "misalignment_kind": WORD,
    "misalignment_deg": pa.float32(),
    "seed": pa.int32(),
    "split": WORD,
    "episode": pa.int32(),
    "step": pa.int16(),
    "global_step": pa.int64(),
    "phase": WORD,
    "time_ns": pa.int64(),
    "observation": pa.list_(pa.float32(), 24),
    "next_observation": pa.list_(pa.float32(), 24),
    "action": pa.list_(pa.float32(), 7),
    "eef_x": pa.float32(),
    "eef_y": pa.float32(),
    "eef_z": pa.float32(),
    "cube_true_x": pa.float32(),
    "cube_true_y": pa.float32(),
    "cube_true_z": pa.float32(),
    "cube_est_x": pa.float32(),
    "cube_est_y": pa.float32(),
    "cube_est_z": pa.float32(),
    "distance_true": pa.float32(),
    "distance_est": pa.float32(),
    "estimation_error": pa.float32(),
    "touched": pa.bool_(),
    "grasped": pa.bool_(),
    "lifted": pa.bool_(),
    "success": pa.bool_(),
    "reward_dense_true": pa.float32(),
    "reward_dense_est": pa.float32(),
    "reward_sparse": pa.float32(),
    "reward_used": pa.float32(),
    "terminated": pa.bool_(),
    "truncated": pa.bool_(),
}

FRAMES = {  # SPEC §4: "episode, step, time_ns, file, split, cube_x/y/z, camera pose"
    "episode": pa.int32(),
    "step": pa.int16(),
    "time_ns": pa.int64(),
    "file": WORD,
    "split": WORD,
    "cube_x": pa.float64(),
    "cube_y": pa.float64(),
    "cube_z": pa.float64(),
    "camera_x": pa.float64(),
    "camera_y": pa.float64(),
    "camera_z": pa.float64(),
    "camera_qw": pa.float64(),
    "camera_qx": pa.float64(),
    "camera_qy": pa.float64(),
    "camera_qz": pa.float64(),
}
ADDED_TO_FRAMES = {"dataset": WORD, "behaviour": WORD}  # beyond SPEC §4: which dataset, and what moved the robot


def columns(schema: pa.Schema) -> dict[str, pa.DataType]:
    return {field.name: field.type for field in schema}


def test_transitions_are_those_of_the_specification() -> None:
    schema = tables.transitions(24, 7)
    assert columns(schema) == TRANSITIONS
    assert schema.names == list(TRANSITIONS)
    assert tables.transitions(24, 8).field("action").type == pa.list_(pa.float32(), 8)


def test_frames_are_those_of_the_specification() -> None:
    assert columns(tables.FRAMES) == FRAMES | ADDED_TO_FRAMES
