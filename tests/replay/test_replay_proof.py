"""A replay proves the logs, and finds the step where they were changed."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.errors import ArtifactError
from schemas.files import write_parquet
from schemas.tables import EPISODES
from stages.replay.logs import load_episode
from stages.replay.proof import replay
from stages.replay.simulate import simulate
from tests.replay.tiny_run import edit_manifest, tamper

MakeRun = Callable[..., Path]


def test_a_logged_episode_replays_bit_for_bit(run_dir: Path):
    result = replay(run_dir, "final", 1)
    assert result.identical
    assert result.first_step is None
    assert result.max_abs_difference == 0.0
    assert result.differences["final_state"].max_abs == 0.0
    assert result.steps == 20
    result.require_identical()
    assert "20 steps replayed, identical" in result.message()


def test_a_lift_episode_replays_too(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=5, task="lift")
    result = replay(run, "final", 0)
    assert {name for name, d in result.differences.items() if d.first_step is not None} <= {
        "reward_dense_true",  # the fixture's rewards are those of reach
        "reward_sparse",
        "success",
    }


def test_the_result_is_json(run_dir: Path):
    said = json.loads(json.dumps(replay(run_dir, "final", 0).as_dict()))
    assert said["identical"] is True
    assert said["first_different_step"] is None
    assert said["differences"]["eef"] == 0.0
    assert said["steps_per_second"] > 0


def test_a_changed_action_differs_from_its_step_on(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=12)
    tamper(run, "action", 5, lambda action: [-action[0] - 0.1, *action[1:]])
    result = replay(run, "final", 0)
    assert result.first_step == 5
    assert result.differences["eef"].first_step == 5
    assert result.differences["eef"].max_abs > 1e-5
    assert result.differences["final_state"].first_step == 11
    with pytest.raises(ArtifactError, match="eef differs, first at step 5"):
        result.require_identical()


def test_a_changed_value_differs_there_alone(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=8)
    tamper(run, "eef_y", 3, lambda y: y + 0.25)
    result = replay(run, "final", 0)
    assert result.first_step == 3
    assert [name for name, d in result.differences.items() if d.first_step is not None] == ["eef"]
    assert result.max_abs_difference == pytest.approx(0.25, abs=1e-6)


@pytest.mark.parametrize("column", ["touched", "lifted", "reward_dense_true", "distance_true", "time_ns", "success"])
def test_every_logged_quantity_of_the_world_is_compared(fresh_run: MakeRun, column: str):
    run = fresh_run(episodes=1, steps=4)
    tamper(run, column, 2, lambda value: not value if isinstance(value, bool) else value + 1)
    result = replay(run, "final", 0)
    assert result.first_step == 2
    assert result.differences[column].max_abs == pytest.approx(1.0)


def test_not_a_number_is_a_difference(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=4)
    tamper(run, "cube_true_z", 1, lambda _: float("nan"))
    result = replay(run, "final", 0)
    assert result.first_step == 1
    assert result.max_abs_difference == np.inf


def test_a_final_state_that_float32_columns_do_not_show(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=4)
    rows = pq.read_table(run / "episodes.parquet").to_pylist()
    rows[0]["final_state"][1] += 1e-13
    write_parquet(pa.Table.from_pylist(rows, schema=EPISODES), run / "episodes.parquet")
    result = replay(run, "final", 0)
    assert [name for name, d in result.differences.items() if d.first_step is not None] == ["final_state"]
    assert result.first_step == 3


def test_a_version_change_is_named_as_the_likely_cause(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=4)
    environment = json.loads((run / "manifest.json").read_text())["environment"]
    edit_manifest(run, environment=environment | {"packages": {"mujoco": "2.0.0", "polars": "0.1"}})
    tamper(run, "eef_x", 0, lambda x: x + 1)
    result = replay(run, "final", 0)
    assert len(result.version_changes) == 1  # polars cannot change a trajectory
    with pytest.raises(ArtifactError, match=r"other versions \(mujoco 2\.0\.0 → "):
        result.require_identical()


def test_a_state_of_another_robot_is_refused(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    rows = pq.read_table(run / "episodes.parquet").to_pylist()
    rows[0]["initial_state"] = rows[0]["initial_state"][:-1]
    write_parquet(pa.Table.from_pylist(rows, schema=EPISODES), run / "episodes.parquet")
    with pytest.raises(ArtifactError, match="it is of another robot"):
        replay(run, "final", 0)


def test_a_world_of_another_version_is_refused(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    config = json.loads((run / "manifest.json").read_text())["config"]
    edit_manifest(run, config=config | {"world": {"gravity_on_the_moon": 1.62}})
    with pytest.raises(ArtifactError, match="describes no known world"):
        replay(run, "final", 0)


def test_watching_sees_the_initial_state_and_every_step(run_dir: Path):
    logged = load_episode(run_dir, "final", 0)
    seen: list[np.ndarray] = []
    trajectory = simulate(logged, lambda world: seen.append(world.integration_state()))
    assert len(seen) == 21
    assert np.array_equal(seen[0], logged.initial_state)
    assert np.array_equal(seen[-1], logged.final_state)
    assert trajectory.initial["time_ns"] == 0
    assert trajectory.states["time_ns"][0] == 50_000_000
