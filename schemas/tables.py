"""Arrow schemas of every Parquet file (SPEC §4, §5). Units: metres, radians, nanoseconds of simulation time."""

import pyarrow as pa

SCHEMA_VERSION = 1

_STRING = pa.dictionary(pa.int32(), pa.string())

IDENTITY = [
    pa.field("run", _STRING),  # NAME/CELL
    pa.field("task", _STRING),  # reach | lift
    pa.field("scheme", _STRING),  # dense | sparse | oracle | dense2sparse
    pa.field("misalignment_kind", _STRING),  # pan | orbit
    pa.field("misalignment_deg", pa.float32()),
    pa.field("seed", pa.int32()),
]


def _xyz(prefix: str, kind: pa.DataType) -> list[pa.Field]:
    return [pa.field(f"{prefix}_{axis}", kind) for axis in "xyz"]


def transitions(observation_dim: int, action_dim: int) -> pa.Schema:
    """One row per environment step (s, a, r, s′, end), SPEC §5. Quantities are of the state *after* the action."""
    return pa.schema(
        [
            *IDENTITY,
            pa.field("split", _STRING),  # train | eval | final
            pa.field("episode", pa.int32()),
            pa.field("step", pa.int16()),
            pa.field("global_step", pa.int64()),  # training steps taken before this row's step
            pa.field("phase", _STRING),  # warmup | dense | sparse
            pa.field("time_ns", pa.int64()),
            pa.field("observation", pa.list_(pa.float32(), observation_dim)),
            pa.field("next_observation", pa.list_(pa.float32(), observation_dim)),
            pa.field("action", pa.list_(pa.float32(), action_dim)),
            *_xyz("eef", pa.float32()),
            *_xyz("cube_true", pa.float32()),
            *_xyz("cube_est", pa.float32()),  # null when the run has no estimator
            pa.field("distance_true", pa.float32()),
            pa.field("distance_est", pa.float32()),
            pa.field("estimation_error", pa.float32()),
            pa.field("touched", pa.bool_()),
            pa.field("grasped", pa.bool_()),
            pa.field("lifted", pa.bool_()),
            pa.field("success", pa.bool_()),
            pa.field("reward_dense_true", pa.float32()),
            pa.field("reward_dense_est", pa.float32()),
            pa.field("reward_sparse", pa.float32()),
            pa.field("reward_used", pa.float32()),
            pa.field("terminated", pa.bool_()),
            pa.field("truncated", pa.bool_()),
        ]
    )


EPISODES = pa.schema(
    [
        *IDENTITY,
        pa.field("split", _STRING),
        pa.field("episode", pa.int32()),  # counted from 0 within its split
        pa.field("global_step", pa.int64()),  # training steps taken before the episode
        pa.field("phase", _STRING),
        pa.field("length", pa.int16()),
        pa.field("return_dense_true", pa.float64()),
        pa.field("return_dense_est", pa.float64()),
        pa.field("return_sparse", pa.float64()),
        pa.field("return_used", pa.float64()),
        pa.field("success", pa.bool_()),  # some step succeeded
        pa.field("steps_to_success", pa.int16()),  # null when none did
        pa.field("mean_estimation_error", pa.float32()),
        pa.field("min_distance_true", pa.float32()),
        pa.field("final_distance_true", pa.float32()),
        pa.field("seed_entropy", pa.list_(pa.int64())),  # what the episode's random streams are derived from
        pa.field("initial_state", pa.list_(pa.float64())),  # MuJoCo integration state, for exact replay
        pa.field("final_state", pa.list_(pa.float64())),  # the same after the last step: proof of identity
        pa.field("wall_time_s", pa.float64()),
    ]
)

EVALUATIONS = pa.schema(
    [
        *IDENTITY,
        pa.field("split", _STRING),  # eval | final
        pa.field("evaluation", pa.int32()),  # counted from 0
        pa.field("after_episode", pa.int32()),  # training episodes finished
        pa.field("global_step", pa.int64()),
        pa.field("phase", _STRING),
        pa.field("episodes", pa.int32()),
        pa.field("mean_return", pa.float64()),  # dense true reward, whatever the run trains on
        pa.field("std_return", pa.float64()),
        pa.field("success_rate", pa.float64()),
        pa.field("mean_steps_to_success", pa.float64()),  # null when no episode succeeded
        pa.field("mean_estimation_error", pa.float64()),
    ]
)

UPDATES = pa.schema(
    [
        *IDENTITY,
        pa.field("update", pa.int64()),  # updates done when the row was written
        pa.field("global_step", pa.int64()),
        pa.field("episode", pa.int32()),
        pa.field("phase", _STRING),
        pa.field("critic1_loss", pa.float32()),  # means over the window since the previous row
        pa.field("critic2_loss", pa.float32()),
        pa.field("actor_loss", pa.float32()),
        pa.field("q1_mean", pa.float32()),
        pa.field("q2_mean", pa.float32()),
        pa.field("target_q_mean", pa.float32()),
    ]
)

FRAMES = pa.schema(
    [
        pa.field("dataset", _STRING),
        pa.field("episode", pa.int32()),
        pa.field("step", pa.int16()),
        pa.field("time_ns", pa.int64()),
        pa.field("file", _STRING),  # relative to the dataset, episodes/episode-000000.mcap
        pa.field("split", _STRING),  # train | validation | test, by episode
        pa.field("behaviour", _STRING),  # random | scripted | policy
        *_xyz("cube", pa.float64()),
        *_xyz("camera", pa.float64()),  # position in the world
        *[pa.field(f"camera_q{axis}", pa.float64()) for axis in "wxyz"],  # world ← camera, optical frame
    ]
)

UNSTABLE_EPISODE = pa.schema(
    [
        pa.field("episode", pa.int32()),
        pa.field("task", _STRING),
        pa.field("behaviour", _STRING),
        pa.field("seed", pa.int64()),  # of the dataset
        pa.field("step", pa.int16()),
        pa.field("action", pa.list_(pa.float32())),  # the last one made it unstable
        pa.field("initial_state", pa.list_(pa.float64())),  # MuJoCo integration state; of the first step alone
    ]
)

EPOCHS = pa.schema(
    [
        pa.field("estimator", _STRING),
        pa.field("epoch", pa.int32()),  # counted from 1
        pa.field("split", _STRING),  # train | validation | test
        pa.field("loss", pa.float64()),  # squared error summed over axes, mean over frames [m²]
        pa.field("mean_error", pa.float64()),  # Euclidean [m]
        pa.field("median_error", pa.float64()),
        pa.field("p95_error", pa.float64()),
        *_xyz("bias", pa.float64()),
        pa.field("learning_rate", pa.float64()),
        pa.field("seconds", pa.float64()),
    ]
)

PREDICTIONS = pa.schema(
    [
        pa.field("estimator", _STRING),
        pa.field("misalignment_kind", _STRING),  # none | pan | orbit
        pa.field("misalignment_deg", pa.float32()),
        pa.field("split", _STRING),
        pa.field("episode", pa.int32()),
        pa.field("step", pa.int16()),
        *_xyz("cube_true", pa.float32()),
        *_xyz("cube_est", pa.float32()),
        pa.field("error", pa.float32()),
    ]
)
