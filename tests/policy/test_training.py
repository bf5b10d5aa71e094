"""The training loop on fake worlds: what it logs, what it learns from, and what its random numbers depend on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from safetensors.numpy import load_file

from schemas import tables
from schemas.progress import Silent
from stages.policy import train
from stages.policy.actor import load_actor
from stages.policy.checkpoint import Position
from stages.policy.config import IN_METRES
from stages.policy.group import Schedule
from stages.policy.log import RunLog
from stages.policy.loop import Lockstep
from stages.policy.observation import sizes
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.td3 import TD3
from stages.sim.state import STATE_DTYPE
from tests.fake_worlds import GRIPPER_RAMP, FakeEstimator, FakeWorlds
from tests.policy.small_training import CONFIG, HORIZON, everything, run_specs, trained, transitions


@pytest.mark.usefixtures("fake")
class TestLog:
    def test_columns_and_types_are_the_contract(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        for part in (spec.out / "transitions").glob("*.parquet"):
            assert pq.read_schema(part).equals(tables.transitions(24, 7))
        assert pq.read_schema(spec.out / "episodes.parquet").equals(tables.EPISODES)
        assert pq.read_schema(spec.out / "evaluations.parquet").equals(tables.EVALUATIONS)
        assert pq.read_schema(spec.out / "updates.parquet").equals(tables.UPDATES)

    def test_rows_are_complete_transitions(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        rows = transitions(spec)
        keys = list(zip(rows["split"], rows["episode"], strict=True))
        for key in set(keys):
            here = [i for i, k in enumerate(keys) if k == key]
            assert rows["step"][here].tolist() == list(range(HORIZON))
            assert np.array_equal(rows["next_observation"][here][:-1], rows["observation"][here][1:])
            assert rows["truncated"][here].tolist() == [False] * (HORIZON - 1) + [True]
        assert not rows["terminated"].any()
        counts = {split: (rows["split"] == split).sum() // HORIZON for split in ("train", "eval", "final")}
        assert counts == {"train": 6, "eval": 6, "final": 3}
        training = rows["split"] == "train"
        assert rows["global_step"][training].tolist() == list(range(6 * HORIZON))

    def test_logged_rewards_follow_from_logged_distances(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        rows = transitions(spec)
        eef, cube = (np.stack([rows[f"{name}_{axis}"] for axis in "xyz"], 1) for name in ("eef", "cube_true"))
        assert np.allclose(rows["distance_true"], np.linalg.norm(eef - cube, axis=1), atol=1e-6)
        dense = np.where(rows["distance_est"] <= 0.03, 1, 1 - np.tanh(10 * rows["distance_est"]))
        assert np.allclose(rows["reward_dense_est"], dense, atol=1e-5)
        assert np.array_equal(rows["reward_used"], rows["reward_dense_est"])
        assert (rows["estimation_error"] > 0).any()

    def test_each_scheme_gets_its_reward_and_phase(self, tmp_path: Path) -> None:
        specs = run_specs(tmp_path, ("dense", "sparse", "oracle", "dense2sparse"))
        trained(specs)
        for spec in specs:
            rows = transitions(spec)
            rows = {name: column[rows["split"] == "train"] for name, column in rows.items()}
            after_switch = rows["episode"] >= CONFIG.switch_episode
            used = {
                "dense": rows["reward_dense_est"],
                "sparse": rows["reward_sparse"],
                "oracle": rows["reward_dense_true"],
                "dense2sparse": np.where(after_switch, rows["reward_sparse"], rows["reward_dense_est"]),
            }[spec.scheme]
            assert np.array_equal(rows["reward_used"], used)
            assert set(rows["phase"][rows["episode"] == 0]) == {"warmup"}
            expected = "sparse" if spec.scheme in ("sparse", "dense2sparse") else "dense"
            assert set(rows["phase"][after_switch]) == {expected}

    def test_the_oracle_sees_the_true_cube_and_the_others_the_estimate(self, tmp_path: Path) -> None:
        specs = run_specs(tmp_path, ("oracle", "dense"))
        trained(specs)
        for spec, seen in zip(specs, ("cube_true", "cube_est"), strict=True):
            rows = transitions(spec)
            cube = np.stack([rows[f"{seen}_{axis}"] for axis in "xyz"], 1)
            assert np.allclose(rows["next_observation"][:, :3], cube, atol=1e-6)

    def test_an_oracle_told_to_acts_on_the_estimate_and_keeps_the_true_reward(self, tmp_path: Path) -> None:
        config = CONFIG.model_copy(update={"oracle_sees": "estimate"})
        [spec] = run_specs(tmp_path, ("oracle",), config)
        trained([spec])
        rows = transitions(spec)
        cube = np.stack([rows[f"cube_est_{axis}"] for axis in "xyz"], 1)
        assert np.allclose(rows["next_observation"][:, :3], cube, atol=1e-6)
        assert not np.allclose(rows["reward_dense_true"], rows["reward_dense_est"])
        assert np.array_equal(rows["reward_used"], rows["reward_dense_true"])

    def test_the_saved_policy_acts_as_logged_on_observations_as_logged(self, tmp_path: Path) -> None:
        """Metres and radians in both: the sizes that its networks learnt with are within the saved first layer."""
        [spec] = run_specs(tmp_path, ("oracle",))
        trained([spec])
        rows, saved = transitions(spec), load_file(spec.out / "checkpoints" / "policy.safetensors")
        final = rows["split"] == "final"
        hidden = np.maximum(rows["observation"][final] @ saved["actor.0.weight"] + saved["actor.0.bias"], 0)
        acted = np.tanh(hidden @ saved["actor.1.weight"] + saved["actor.1.bias"])
        np.testing.assert_allclose(acted, rows["action"][final], atol=1e-5)

    def test_evaluations_report_the_dense_true_reward(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("sparse",))
        [result] = trained([spec])
        evaluations = pq.read_table(spec.out / "evaluations.parquet").to_pylist()
        assert [(e["split"], e["after_episode"], e["episodes"]) for e in evaluations] == [
            ("eval", 2, 2), ("eval", 4, 2), ("eval", 6, 2), ("final", 6, 3)
        ]  # fmt: skip
        rows = transitions(spec)
        final = rows["split"] == "final"
        assert evaluations[-1]["mean_return"] == pytest.approx(rows["reward_dense_true"][final].sum() / 3, rel=1e-5)
        assert result.summary["final_return"] == evaluations[-1]["mean_return"]

    def test_the_last_step_is_truncated_and_bootstraps(self, tmp_path: Path) -> None:
        """The horizon is no end: what the buffer holds of step T − 1 is not terminal, so TD3 bootstraps."""
        [spec] = run_specs(tmp_path, ("dense",))
        td3, buffer = TD3(CONFIG.td3, 24, 7, [0]), ReplayBuffer(1, 100, 24, 7)
        lockstep = Lockstep([spec], FakeWorlds(1), FakeEstimator(), td3, buffer, [RunLog(spec, 24, 7)])
        Schedule(lockstep, td3, [spec], lockstep.logs).run(Position(0, 0), Silent())
        rows = transitions(spec)
        last = rows["truncated"] & (rows["split"] == "train")
        batch = buffer.sample(2000, [np.random.default_rng(0)], "cpu")
        held = {tuple(row) for row in batch.next_observation[0].numpy().round(5).tolist()}
        assert all(tuple(row) in held for row in rows["next_observation"][last].astype(np.float32).round(5).tolist())
        assert not batch.terminated.any() and not rows["terminated"].any()

    def test_evaluation_acts_by_the_policy_alone_on_fresh_resets(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        rows = transitions(spec)
        cubes = {split: set(rows["cube_true_x"][rows["split"] == split]) for split in ("train", "eval", "final")}
        assert not (cubes["train"] & cubes["eval"]) and not (cubes["eval"] & cubes["final"])
        saved, final = load_file(spec.out / "checkpoints" / "policy.safetensors"), rows["split"] == "final"
        hidden = np.maximum(rows["observation"][final] @ saved["actor.0.weight"] + saved["actor.0.bias"], 0)
        policy = np.tanh(hidden @ saved["actor.1.weight"] + saved["actor.1.bias"])
        assert np.allclose(rows["action"][final], policy, atol=1e-5)

    def test_update_rows(self, tmp_path: Path) -> None:
        """5 learning episodes of 6 updates, a row every 4 and at the episode's end: 10 rows, 30 updates."""
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        rows = pq.read_table(spec.out / "updates.parquet").to_pylist()
        assert [row["update"] for row in rows] == [4, 6, 10, 12, 16, 18, 22, 24, 28, 30]
        assert all(np.isfinite(row["critic1_loss"]) for row in rows)

    def test_critics_that_catch_up_are_logged_as_such(self, tmp_path: Path) -> None:
        """Nine updates at the switch, in windows of four, before those of the steps; no actor learns in them."""
        config = CONFIG.model_copy(update={"reset": "critics", "reset_updates": 9})
        [spec] = run_specs(tmp_path, ("dense2sparse",), config)
        trained([spec])
        rows = [row for row in pq.read_table(spec.out / "updates.parquet").to_pylist() if row["episode"] == 4]
        assert [row["update"] for row in rows] == [22, 26, 27, 31, 33]
        assert [row["actor_loss"] is None for row in rows] == [True, True, True, False, False]
        assert {(row["global_step"], row["phase"]) for row in rows[:3]} == {(4 * HORIZON, "sparse")}


@pytest.mark.usefixtures("fake")
class TestSeeds:
    def test_a_run_in_a_matrix_is_the_same_run_alone(self, tmp_path: Path) -> None:
        """Same resets, exploration noise and batches, so the same logs and weights to the last bit."""
        alone = run_specs(tmp_path / "alone", ("dense",))
        matrix = run_specs(tmp_path / "matrix", ("sparse", "dense", "oracle"))
        trained(alone)
        trained(matrix)
        assert everything(alone[0]) == everything(matrix[1])

    def test_runs_that_switch_differently_step_together_and_stay_what_they_are_alone(self, tmp_path: Path) -> None:
        variants = [
            CONFIG.model_copy(
                update={"switch_episode": switch, "buffer": buffer, "reset": reset, "reset_updates": updates}
            )
            for switch, buffer, reset, updates in (
                (4, "relabel", "none", 0),
                (2, "keep", "critics", 0),
                (3, "empty", "all", 9),
                (2, "relabel", "critics", 5),
                (2, "relabel", "critics", 8),
            )
        ]
        alone, together = (
            [run_specs(tmp_path / f"{name}{i}", ("dense2sparse",), config)[0] for i, config in enumerate(variants)]
            for name in ("alone", "together")
        )
        assert [len(group) for group in train.groups(together)] == [5]
        for spec in alone:
            trained([spec])
        trained(together)
        assert [everything(spec) for spec in alone] == [everything(spec) for spec in together]
        assert len({str(everything(spec)) for spec in together}) == 5, "they differ, or the comparison says nothing"

    def test_the_same_command_gives_the_same_bytes(self, tmp_path: Path) -> None:
        specs = [run_specs(tmp_path / name, ("dense2sparse",))[0] for name in ("a", "b")]
        for spec in specs:
            trained([spec])
        parts = [sorted((spec.out / "transitions").glob("*")) for spec in specs]
        assert [p.read_bytes() for p in parts[0]] == [p.read_bytes() for p in parts[1]]

    def test_another_seed_gives_another_run(self, tmp_path: Path) -> None:
        a, b = (run_specs(tmp_path, ("dense",), seed=seed)[0] for seed in (0, 1))
        trained([a])
        trained([b])
        assert not np.array_equal(transitions(a)["cube_true_x"], transitions(b)["cube_true_x"])


def test_runs_of_different_settings_are_not_mixed(tmp_path: Path) -> None:
    specs = run_specs(tmp_path, ("dense", "sparse"))
    other = replace(specs[0], config=CONFIG.model_copy(update={"episodes": 7}))
    lift = replace(specs[0], task="lift")
    assert [len(group) for group in train.groups([*specs, other, lift])] == [2, 1, 1]


def test_emptying_the_buffer_pauses_learning_until_there_is_data(tmp_path: Path) -> None:
    """The switch's first step has nothing to learn from: the networks wait instead of learning from zeros."""
    config = CONFIG.model_copy(update={"buffer": "empty"})
    [spec] = run_specs(tmp_path, ("dense2sparse",), config)
    worlds = FakeWorlds(1)
    td3, buffer = TD3(config.td3, 24, 7, [0]), ReplayBuffer(1, 100, 24, 7)
    lockstep = Lockstep([spec], worlds, FakeEstimator(), td3, buffer, [RunLog(spec, 24, 7)])
    Schedule(lockstep, td3, [spec], lockstep.logs).run(Position(0, 0), Silent())
    # 5 learning episodes of 6 steps, less the first step after the switch
    assert td3.updates.item() == 5 * HORIZON - 1


def test_the_learning_rate_falls_while_a_run_trains(tmp_path: Path) -> None:
    """Of 6 episodes the last begins when 5/6 are done: two thirds of the fall to a tenth, 1 − 2/3 · 0.9 = 0.4."""
    [spec] = run_specs(tmp_path, ("dense",))
    td3, buffer = TD3(CONFIG.td3, 24, 7, [0]), ReplayBuffer(1, 100, 24, 7)
    lockstep = Lockstep([spec], FakeWorlds(1), FakeEstimator(), td3, buffer, [RunLog(spec, 24, 7)])
    Schedule(lockstep, td3, [spec], lockstep.logs).run(Position(0, 0), Silent())
    assert td3.actor_optimiser.learning_rate == pytest.approx(0.4 * CONFIG.td3.learning_rate)


@pytest.mark.usefixtures("fake")
def test_networks_see_observations_by_their_sizes(tmp_path: Path) -> None:
    """Networks that never learn are as drawn; published ones take metres, so their first layer is that by the sizes."""
    still = CONFIG.model_copy(update={"updates_per_step": 0})
    sized, plain = (
        run_specs(tmp_path / name, ("dense",), still.model_copy(update={"observation_scale": scale}))[0]
        for name, scale in (("sized", still.observation_scale), ("plain", IN_METRES))
    )
    trained([sized])
    trained([plain])
    first = [load_file(spec.out / "checkpoints" / "policy.safetensors")["actor.0.weight"] for spec in (sized, plain)]
    by = sizes(still.observation_scale, still.proprioception)
    assert by[0] == np.float32(0.15)
    np.testing.assert_allclose(first[0] * by[:, None], first[1], rtol=1e-6)


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(("correlation", "same_sign"), [(0.0, 0.5), (0.85, 0.82)])
def test_exploration_goes_on_as_correlated(tmp_path: Path, correlation: float, same_sign: float) -> None:
    """Noise so wide that it alone decides: of neighbours of a normal process 1/2 + asin(ρ)/π have the same sign."""
    td3 = CONFIG.td3.model_copy(update={"exploration_noise": 100.0, "exploration_correlation": correlation})
    [spec] = run_specs(tmp_path, ("dense",), CONFIG.model_copy(update={"td3": td3, "episodes": 20, "eval_every": 20}))
    trained([spec])
    rows = transitions(spec)
    signs = np.sign(rows["action"][(rows["split"] == "train") & (rows["phase"] != "warmup")])
    episodes = signs.reshape(19, HORIZON, -1)
    assert (episodes[:, 1:] == episodes[:, :-1]).mean() == pytest.approx(same_sign, abs=0.06)


@pytest.mark.usefixtures("fake")
def test_lifting_policies_may_be_told_where_the_gripper_is_going(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"proprioception": "gripper_goal"})
    spec = replace(run_specs(tmp_path, ("dense",), config)[0], task="lift")
    trained([spec])
    rows = transitions(spec)
    goal, after = rows["observation"][:, -1], rows["next_observation"][:, -1]
    assert rows["observation"].shape[1] == 25
    np.testing.assert_allclose(after, np.clip(goal + GRIPPER_RAMP * np.sign(rows["action"][:, 7]), -1, 1), atol=1e-6)
    assert load_actor(spec.out).act(np.zeros((), STATE_DTYPE)[()], "lift").shape == (8,)
