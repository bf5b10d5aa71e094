"""A small run as the policy room logs it, made by stepping the real world with a fake estimator."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.artifacts.manifests import list_files
from schemas.files import write_parquet
from schemas.manifest import config_sha256
from schemas.mcap_files import read_messages
from schemas.mcap_topics import CUBE_POSE
from schemas.tables import EPISODES, FRAMES, SCHEMA_VERSION, transitions
from stages.replay.export import export_episode
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.scene import build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World

RUN_NAME, CELL = "tiny", "reach-dense2sparse-orbit05-seed0"
ESTIMATOR = "eye"
BIAS = np.array([0.02, -0.01, 0.004])  # [m], of the fake estimator


def make_run(data: Path, episodes: int = 2, steps: int = 20, task: str = "reach") -> Path:
    """A run directory with `episodes` final episodes of `steps` steps, and its estimator."""
    run_dir = data / "runs" / RUN_NAME / CELL
    (run_dir / "transitions").mkdir(parents=True)
    rng = np.random.default_rng(7)
    logged = [_play(episode, steps, task, rng) for episode in range(episodes)]
    for part, (rows, _) in enumerate(logged):
        table = pa.Table.from_pylist(rows, schema=transitions(23, len(rows[0]["action"])))
        write_parquet(table, run_dir / "transitions" / f"part-{part:05d}.parquet")
    write_parquet(pa.Table.from_pylist([row for _, row in logged], schema=EPISODES), run_dir / "episodes.parquet")
    _write(run_dir, _manifest(task))
    make_estimator(data)
    return run_dir


def make_estimator(data: Path) -> Path:
    """An estimator's directory with the one file replay reads."""
    directory = data / "estimators" / ESTIMATOR
    directory.mkdir(parents=True)
    (directory / "estimator.json").write_text(json.dumps({"camera": CameraConfig().model_dump()}))
    return directory


def make_dataset(run_dir: Path, out: Path) -> Path:
    """A dataset whose one episode is the run's first, in the layout of the collect room; all frames are of the test."""
    (out / "episodes").mkdir(parents=True)
    file = "episodes/episode-000000.mcap"
    export_episode(run_dir, "final", 0, out / file)
    rows = [_frame_row(out.name, file, time, message) for _, time, message in read_messages(out / file, CUBE_POSE)]
    write_parquet(pa.Table.from_pylist(rows, schema=FRAMES), out / "frames.parquet")
    manifest = _manifest("reach") | {"id": f"datasets/{out.name}", "stage": "collect", "name": out.name}
    _write(out, manifest)
    return out


def _write(directory: Path, manifest: dict[str, Any]) -> None:
    """The manifest of what is there."""
    files = [file.model_dump() for file in list_files(directory)]
    (directory / "manifest.json").write_text(json.dumps(manifest | {"files": files}))


def _frame_row(dataset: str, file: str, time_ns: int, cube: Any) -> dict[str, Any]:
    position = cube.pose.position
    identity = {"dataset": dataset, "episode": 0, "step": time_ns // 50_000_000, "time_ns": time_ns, "file": file}
    place = {"cube_x": position.x, "cube_y": position.y, "cube_z": position.z}
    camera = {name: 0.0 for name in FRAMES.names if name.startswith("camera_")}
    return identity | place | camera | {"split": "test", "behaviour": "policy"}


def tamper(run_dir: Path, column: str, step: int, change: Callable[[Any], Any], part: int = 0) -> None:
    """Change one value of a part's transitions, as a faulty disk or a clever hand would."""
    path = run_dir / "transitions" / f"part-{part:05d}.parquet"
    table = pq.read_table(path)
    rows = table.to_pylist()
    rows[step][column] = change(rows[step][column])
    write_parquet(pa.Table.from_pylist(rows, schema=table.schema), path)


def edit_manifest(directory: Path, **fields: Any) -> None:
    """Replace top-level fields of a manifest, which bears no seal then; the configuration with its hash."""
    path = directory / "manifest.json"
    if "config" in fields:
        fields = {"config_sha256": config_sha256(fields["config"])} | fields
    path.write_text(json.dumps(json.loads(path.read_text()) | {"seal": None} | fields))


def _play(episode: int, steps: int, task: str, rng: np.random.Generator) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    scene = build_scene(WorldConfig())
    world = World(scene, task)
    initial = sample_initial_state(scene, task, rng)
    state = world.reset(initial)
    rows = []
    for step in range(steps):
        estimate = state["cube_position"] + BIAS + rng.normal(0, 0.005, 3)
        action = _towards(world, state["eef"], estimate, rng)
        state = world.step(action)
        rows.append(_row(episode, step, steps, action, state, state["cube_position"] + BIAS + rng.normal(0, 0.005, 3)))
    return rows, _summary(episode, rows, initial, world.integration_state())


def _towards(world: World, eef: np.ndarray, goal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    velocity = 4.0 * (goal - eef)  # [m/s]
    joints = np.linalg.pinv(world.gripper_jacobian()) @ velocity / 0.5
    action = np.zeros(world.action_dim)
    action[:7] = np.clip(joints + rng.normal(0, 0.1, 7), -1, 1)
    return action.astype(np.float32)


def _identity() -> dict[str, Any]:
    return {
        "run": f"{RUN_NAME}/{CELL}",
        "task": "reach",
        "scheme": "dense2sparse",
        "misalignment_kind": "orbit",
        "misalignment_deg": 5.0,
        "seed": 0,
        "split": "final",
    }


def _row(
    episode: int, step: int, steps: int, action: np.ndarray, state: np.void, estimate: np.ndarray
) -> dict[str, Any]:
    cube, eef = state["cube_position"], state["eef"]
    true, est = float(np.linalg.norm(eef - cube)), float(np.linalg.norm(eef - estimate))
    success = bool(state["touched"]) or true <= 0.03
    dense = [1.0 if d <= 0.03 else 1 - float(np.tanh(10 * d)) for d in (true, est)]  # equation 3
    places = {"eef": eef, "cube_true": cube, "cube_est": estimate}
    return _identity() | {
        "episode": episode,
        "step": step,
        "global_step": 100,
        "phase": "dense" if step < steps // 2 else "sparse",
        "time_ns": int(state["time_ns"]),
        "observation": [0.0] * 23,
        "next_observation": [0.0] * 23,
        "action": action.tolist(),
        **{f"{name}_{axis}": float(xyz[i]) for name, xyz in places.items() for i, axis in enumerate("xyz")},
        "distance_true": true,
        "distance_est": est,
        "estimation_error": float(np.linalg.norm(estimate - cube)),
        "touched": bool(state["touched"]),
        "grasped": bool(state["grasped"]),
        "lifted": bool(state["lifted"]),
        "success": success,
        "reward_dense_true": dense[0],
        "reward_dense_est": dense[1],
        "reward_sparse": float(success),
        "reward_used": float(success) if step >= steps // 2 else dense[1],
        "terminated": False,
        "truncated": step == steps - 1,
    }


def _summary(episode: int, rows: list[dict[str, Any]], initial: np.ndarray, final: np.ndarray) -> dict[str, Any]:
    successes = [row["step"] + 1 for row in rows if row["success"]]
    distances = [row["distance_true"] for row in rows]
    return _identity() | {
        "episode": episode,
        "global_step": 100,
        "phase": "sparse",
        "length": len(rows),
        **{
            f"return_{name}": sum(row[f"reward_{name}"] for row in rows)
            for name in ("dense_true", "dense_est", "sparse", "used")
        },
        "success": bool(successes),
        "steps_to_success": successes[0] if successes else None,
        "mean_estimation_error": float(np.mean([row["estimation_error"] for row in rows])),
        "min_distance_true": min(distances),
        "final_distance_true": distances[-1],
        "seed_entropy": [0, episode],
        "initial_state": initial.tolist(),
        "final_state": final.tolist(),
        "wall_time_s": 0.1,
    }


def _manifest(task: str) -> dict[str, Any]:
    identity = _identity()
    run = {name: identity[name] for name in ("scheme", "misalignment_kind", "misalignment_deg", "seed")}
    config = {
        "world": WorldConfig().model_dump(mode="json"),
        "policy": {"switch_episode": 0},
        "run": run | {"task": task},
        "estimator": ESTIMATOR,
    }
    return {
        "id": f"runs/{RUN_NAME}/{CELL}",
        "stage": "train-policy",
        "name": f"{RUN_NAME}/{CELL}",
        "schema_version": SCHEMA_VERSION,
        "status": "complete",
        "created_at": "2026-01-01T00:00:00+00:00",
        "config": config,
        "config_sha256": config_sha256(config),
        "inputs": [],
        "code": {"version": "0", "git_commit": None, "dirty": None},
        "environment": {
            "python": "3.11",
            "platform": "test",
            "cpu": "test",
            "gpu": None,
            "gl_renderer": None,
            "packages": {},
        },
    }
