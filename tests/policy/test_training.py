"""The training loop on fake worlds: what it logs, what it learns from, and that resuming changes nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from safetensors.numpy import load_file

from schemas import tables
from schemas.errors import ArtifactError, ConfigError, MachineError
from schemas.progress import Silent
from stages.policy import checkpoint, group, train
from stages.policy.checkpoint import Position
from stages.policy.config import RunConfig, RunResult, RunSpec, TD3Config
from stages.policy.group import Schedule
from stages.policy.log import RunLog
from stages.policy.loop import Lockstep
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.resources import Resources
from stages.policy.td3 import TD3
from stages.sim.config import WorldConfig
from tests.fake_worlds import FakeEstimator, FakeWorlds

HORIZON = 6
CONFIG = RunConfig(
    episodes=6,
    warmup_episodes=1,
    switch_episode=4,
    buffer="relabel",
    eval_every=2,
    eval_episodes=2,
    final_episodes=3,
    checkpoint_every=2,
    log_updates_every=4,
    td3=TD3Config(hidden=(8,), batch_size=16),
)


def _specs(root: Path, schemes: tuple[str, ...], config: RunConfig = CONFIG, seed: int = 0) -> list[RunSpec]:
    specs = []
    for scheme in schemes:
        out = root / f"reach-{scheme}-pan00-seed{seed}"
        out.mkdir(parents=True, exist_ok=True)
        world = WorldConfig(horizon=HORIZON)
        specs.append(RunSpec(f"t/{out.name}", "reach", scheme, "pan", 0.0, seed, world, config, out))  # type: ignore
    return specs


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> dict[int, int]:
    """Replace worlds and estimator by fakes; the returned dict says which world diverges at which step."""
    diverge: dict[int, int] = {}

    def make(config: WorldConfig, task: str, n: int, view: object, workers: int) -> FakeWorlds:
        worlds = FakeWorlds(n, task, 32 if view else None)
        worlds.diverge_at = diverge
        return worlds

    monkeypatch.setattr(group, "WorldPool", make)
    monkeypatch.setattr(group.Estimator, "load", lambda *_, **__: FakeEstimator())
    return diverge


def _train(specs: list[RunSpec], estimator: bool = True) -> list[RunResult]:
    path, results = Path("estimator") if estimator else None, []
    train.run(specs, path, resources=Resources(processes=1), finished=results.append, progress=Silent())
    return results


def _transitions(spec: RunSpec) -> dict[str, np.ndarray]:
    parts = sorted((spec.out / "transitions").glob("*.parquet"))
    table = pa.concat_tables(map(pq.read_table, parts))
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


@pytest.mark.usefixtures("fake")
class TestLog:
    def test_columns_and_types_are_the_contract(self, tmp_path: Path) -> None:
        [spec] = _specs(tmp_path, ("dense",))
        _train([spec])
        for part in (spec.out / "transitions").glob("*.parquet"):
            assert pq.read_schema(part).equals(tables.transitions(24, 7))
        assert pq.read_schema(spec.out / "episodes.parquet").equals(tables.EPISODES)
        assert pq.read_schema(spec.out / "evaluations.parquet").equals(tables.EVALUATIONS)
        assert pq.read_schema(spec.out / "updates.parquet").equals(tables.UPDATES)

    def test_rows_are_complete_transitions(self, tmp_path: Path) -> None:
        [spec] = _specs(tmp_path, ("dense",))
        _train([spec])
        rows = _transitions(spec)
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
        [spec] = _specs(tmp_path, ("dense",))
        _train([spec])
        rows = _transitions(spec)
        eef, cube = (np.stack([rows[f"{name}_{axis}"] for axis in "xyz"], 1) for name in ("eef", "cube_true"))
        assert np.allclose(rows["distance_true"], np.linalg.norm(eef - cube, axis=1), atol=1e-6)
        dense = np.where(rows["distance_est"] <= 0.03, 1, 1 - np.tanh(10 * rows["distance_est"]))
        assert np.allclose(rows["reward_dense_est"], dense, atol=1e-5)
        assert np.array_equal(rows["reward_used"], rows["reward_dense_est"])
        assert (rows["estimation_error"] > 0).any()

    def test_each_scheme_gets_its_reward_and_phase(self, tmp_path: Path) -> None:
        specs = _specs(tmp_path, ("dense", "sparse", "oracle", "dense2sparse"))
        _train(specs)
        for spec in specs:
            rows = _transitions(spec)
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
        specs = _specs(tmp_path, ("oracle", "dense"))
        _train(specs)
        for spec, seen in zip(specs, ("cube_true", "cube_est"), strict=True):
            rows = _transitions(spec)
            cube = np.stack([rows[f"{seen}_{axis}"] for axis in "xyz"], 1)
            assert np.allclose(rows["next_observation"][:, :3], cube, atol=1e-6)

    def test_evaluations_report_the_dense_true_reward(self, tmp_path: Path) -> None:
        [spec] = _specs(tmp_path, ("sparse",))
        [result] = _train([spec])
        evaluations = pq.read_table(spec.out / "evaluations.parquet").to_pylist()
        assert [(e["split"], e["after_episode"], e["episodes"]) for e in evaluations] == [
            ("eval", 2, 2), ("eval", 4, 2), ("eval", 6, 2), ("final", 6, 3)
        ]  # fmt: skip
        rows = _transitions(spec)
        final = rows["split"] == "final"
        assert evaluations[-1]["mean_return"] == pytest.approx(rows["reward_dense_true"][final].sum() / 3, rel=1e-5)
        assert result.summary["final_return"] == evaluations[-1]["mean_return"]

    def test_the_last_step_is_truncated_and_bootstraps(self, tmp_path: Path) -> None:
        """The horizon is no end: what the buffer holds of step T − 1 is not terminal, so TD3 bootstraps."""
        [spec] = _specs(tmp_path, ("dense",))
        td3, buffer = TD3(CONFIG.td3, 24, 7, [0]), ReplayBuffer(1, 100, 24, 7)
        lockstep = Lockstep([spec], FakeWorlds(1), FakeEstimator(), td3, buffer, [RunLog(spec, 24, 7)])
        Schedule(lockstep, td3, [spec], lockstep.logs).run(Position(0, 0), Silent())
        rows = _transitions(spec)
        last = rows["truncated"] & (rows["split"] == "train")
        batch = buffer.sample(2000, [np.random.default_rng(0)], "cpu")
        held = {tuple(row) for row in batch.next_observation[0].numpy().round(5).tolist()}
        assert all(tuple(row) in held for row in rows["next_observation"][last].astype(np.float32).round(5).tolist())
        assert not batch.terminated.any() and not rows["terminated"].any()

    def test_evaluation_acts_by_the_policy_alone_on_fresh_resets(self, tmp_path: Path) -> None:
        [spec] = _specs(tmp_path, ("dense",))
        _train([spec])
        rows = _transitions(spec)
        cubes = {split: set(rows["cube_true_x"][rows["split"] == split]) for split in ("train", "eval", "final")}
        assert not (cubes["train"] & cubes["eval"]) and not (cubes["eval"] & cubes["final"])
        saved, final = load_file(spec.out / "checkpoints" / "policy.safetensors"), rows["split"] == "final"
        hidden = np.maximum(rows["observation"][final] @ saved["actor.0.weight"] + saved["actor.0.bias"], 0)
        policy = np.tanh(hidden @ saved["actor.1.weight"] + saved["actor.1.bias"])
        assert np.allclose(rows["action"][final], policy, atol=1e-5)

    def test_update_rows(self, tmp_path: Path) -> None:
        """5 learning episodes of 6 updates, a row every 4 and at the episode's end: 10 rows, 30 updates."""
        [spec] = _specs(tmp_path, ("dense",))
        _train([spec])
        rows = pq.read_table(spec.out / "updates.parquet").to_pylist()
        assert [row["update"] for row in rows] == [4, 6, 10, 12, 16, 18, 22, 24, 28, 30]
        assert all(np.isfinite(row["critic1_loss"]) for row in rows)


@pytest.mark.usefixtures("fake")
class TestSeeds:
    def test_a_run_in_a_matrix_is_the_same_run_alone(self, tmp_path: Path) -> None:
        """Same resets, exploration noise and batches, so the same logs and weights to the last bit."""
        alone = _specs(tmp_path / "alone", ("dense",))
        matrix = _specs(tmp_path / "matrix", ("sparse", "dense", "oracle"))
        _train(alone)
        _train(matrix)
        assert _whole(alone[0]) == _whole(matrix[1])

    def test_runs_that_switch_differently_step_together_and_stay_what_they_are_alone(self, tmp_path: Path) -> None:
        variants = [
            CONFIG.model_copy(update={"switch_episode": switch, "buffer": buffer, "reset": reset})
            for switch, buffer, reset in ((4, "relabel", "none"), (2, "keep", "critics"), (3, "empty", "all"))
        ]
        alone, together = (
            [_specs(tmp_path / f"{name}{i}", ("dense2sparse",), config)[0] for i, config in enumerate(variants)]
            for name in ("alone", "together")
        )
        assert [len(group) for group in train.groups(together)] == [3]
        for spec in alone:
            _train([spec])
        _train(together)
        assert [_whole(spec) for spec in alone] == [_whole(spec) for spec in together]
        assert len({str(_whole(spec)) for spec in together}) == 3, "they differ, or the comparison says nothing"

    def test_the_same_command_gives_the_same_bytes(self, tmp_path: Path) -> None:
        specs = [_specs(tmp_path / name, ("dense2sparse",))[0] for name in ("a", "b")]
        for spec in specs:
            _train([spec])
        parts = [sorted((spec.out / "transitions").glob("*")) for spec in specs]
        assert [p.read_bytes() for p in parts[0]] == [p.read_bytes() for p in parts[1]]

    def test_another_seed_gives_another_run(self, tmp_path: Path) -> None:
        a, b = (_specs(tmp_path, ("dense",), seed=seed)[0] for seed in (0, 1))
        _train([a])
        _train([b])
        assert not np.array_equal(_transitions(a)["cube_true_x"], _transitions(b)["cube_true_x"])


class _StopError(Exception):
    pass


@pytest.mark.usefixtures("fake")
class TestResume:
    @pytest.mark.parametrize("buffer", ["keep", "relabel", "empty"])
    @pytest.mark.parametrize("stop_after", [1, 6, 14, 19])
    def test_resumed_equals_uninterrupted(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop_after: int, buffer: str
    ) -> None:
        """Going on from nothing, from before the switch (2), from after it (6) and from the final evaluation.

        Rollouts come as 2 training and 2 evaluation episodes in turn, ten of each, then the final ones.
        """
        config = CONFIG.model_copy(update={"buffer": buffer, "reset": "critics", "episodes": 10, "final_episodes": 5})
        schemes = ("dense2sparse", "dense")
        whole, broken = _specs(tmp_path / "whole", schemes, config), _specs(tmp_path / "broken", schemes, config)
        _train(whole)
        calls, original = [], Lockstep._rollout

        def stopping(self: Lockstep, *arguments: object) -> None:
            calls.append(arguments)
            if len(calls) > stop_after:
                raise _StopError
            original(self, *arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "_rollout", stopping)
        with pytest.raises(_StopError):
            _train(broken)
        resume_points = {1: [], 6: [2], 14: [4, 6], 19: [6, 8]}
        assert [point.episodes for point in checkpoint.available(broken[0].out)] == resume_points[stop_after]
        monkeypatch.setattr(Lockstep, "_rollout", original)
        _train(broken)
        for one, other in zip(whole, broken, strict=True):
            assert _whole(one) == _whole(other)

    def test_runs_killed_one_checkpoint_apart_go_on_from_the_older(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Killed while the second run's checkpoint at 4 was to be written: both go on from 2, and end the same."""
        whole, broken = (_specs(tmp_path / name, ("dense", "sparse")) for name in ("whole", "broken"))
        _train(whole)
        original = checkpoint.save

        def killed(out: Path, position: Position, td3: TD3, row: int, counts: dict[str, int]) -> None:
            if position.episodes == 4 and row == 1:
                raise _StopError
            original(out, position, td3, row, counts)

        monkeypatch.setattr(checkpoint, "save", killed)
        with pytest.raises(_StopError):
            _train(broken)
        assert [[p.episodes for p in checkpoint.available(spec.out)] for spec in broken] == [[2, 4], [2]]
        monkeypatch.setattr(checkpoint, "save", original)
        _train(broken)
        assert [_whole(spec) for spec in whole] == [_whole(spec) for spec in broken]

    def test_a_run_that_ended_is_not_trained_again(self, tmp_path: Path) -> None:
        """Killed after the policy was kept and before the manifest said so: the result is there, the files stay."""
        [spec] = _specs(tmp_path, ("dense",))
        [result] = _train([spec])
        before = {path: path.stat().st_mtime_ns for path in spec.out.rglob("*") if path.is_file()}
        assert _train([spec]) == [result]
        assert before == {path: path.stat().st_mtime_ns for path in spec.out.rglob("*") if path.is_file()}

    def test_results_come_as_soon_as_a_group_has_ended(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """An interruption in the second group leaves the first group's results as they are."""
        specs = _specs(tmp_path / "a", ("dense",))
        specs += _specs(tmp_path / "b", ("dense",), CONFIG.model_copy(update={"episodes": 8}))
        original, results = Lockstep.train_episode, []

        def stopping(self: Lockstep, episode: int, task: object) -> None:
            if self.config.episodes == 8:
                raise KeyboardInterrupt
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", stopping)
        with pytest.raises(KeyboardInterrupt):
            train.run(specs, Path("e"), resources=Resources(processes=1), finished=results.append, progress=Silent())
        assert [result.run_id for result in results] == [specs[0].run_id]

    def test_a_damaged_checkpoint_is_a_clear_error(self, tmp_path: Path) -> None:
        [spec] = _specs(tmp_path, ("dense",))
        directory = spec.out / "checkpoints" / "000002-000000"
        directory.mkdir(parents=True)
        (directory / "td3.safetensors").write_bytes(b"not a checkpoint")
        with pytest.raises(ArtifactError, match="checkpoint .*000002-000000 cannot be read"):
            _train([spec])


def _whole(spec: RunSpec) -> dict[str, object]:
    """A run's logs and weights, without wall time; parts may be cut differently, their rows not."""
    rows = _transitions(spec)
    logs = {name: rows[name].tolist() for name in rows}
    for name in ("episodes", "evaluations", "updates"):
        table = pq.read_table(spec.out / f"{name}.parquet")
        logs[name] = [{k: v for k, v in row.items() if k != "wall_time_s"} for row in table.to_pylist()]
    logs["weights"] = (spec.out / "checkpoints" / "policy.safetensors").read_bytes()
    return logs


class TestFailures:
    def test_an_unstable_run_ends_and_its_neighbours_go_on(self, tmp_path: Path, fake: dict[int, int]) -> None:
        fake[1] = 3
        specs = _specs(tmp_path, ("dense", "sparse", "oracle"))
        results = _train(specs)
        assert [result.status for result in results] == ["complete", "failed", "complete"]
        assert "unstable in train episode 0, step 3" in (results[1].error or "")
        assert not list((specs[1].out / "transitions").glob("*")), "an episode that diverged is not data"
        assert results[0].summary["episodes"] == 6

    def test_when_every_run_fails_it_stops_and_keeps_what_was_finished(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]
    ) -> None:
        [spec] = _specs(tmp_path, ("dense",))
        original = Lockstep.train_episode

        def third_diverges(self: Lockstep, episode: int, task: object) -> None:
            if episode == 3:
                fake[0] = 2
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", third_diverges)
        [result] = _train([spec])
        assert result.status == "failed" and "train episode 3, step 2" in (result.error or "")
        rows = _transitions(spec)
        assert set(rows["episode"][rows["split"] == "train"]) == {0, 1, 2}
        assert result.summary["episodes"] == 3

    def test_a_failed_run_resumes_from_its_checkpoint(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]
    ) -> None:
        """Episodes after the checkpoint are run again, not learnt from twice."""
        [whole], [broken] = (_specs(tmp_path / name, ("dense2sparse",)) for name in ("whole", "broken"))
        _train([whole])
        original = Lockstep.train_episode

        def fourth_diverges(self: Lockstep, episode: int, task: object) -> None:
            if episode == 3:
                fake[0] = 2
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", fourth_diverges)
        assert _train([broken])[0].status == "failed"
        monkeypatch.setattr(Lockstep, "train_episode", original)
        fake.clear()
        assert _train([broken])[0].status == "complete"
        assert _whole(whole) == _whole(broken)

    @pytest.mark.usefixtures("fake")
    def test_without_an_estimator_only_the_oracle_trains(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="--estimator"):
            _train(_specs(tmp_path, ("dense",)), estimator=False)
        [spec] = _specs(tmp_path, ("oracle",))
        [result] = _train([spec], estimator=False)
        rows = pq.read_table(spec.out / "episodes.parquet").to_pylist()
        assert result.status == "complete" and all(row["return_dense_est"] is None for row in rows)

    def test_no_gpu_is_exit_4(self, tmp_path: Path) -> None:
        import torch

        if torch.cuda.is_available():
            pytest.skip("this machine has a GPU")
        with pytest.raises(MachineError, match="no GPU"):
            specs = _specs(tmp_path, ("oracle",))
            train.run(specs, None, resources=Resources("cuda"), finished=print, progress=Silent())


def test_runs_of_different_settings_are_not_mixed(tmp_path: Path) -> None:
    specs = _specs(tmp_path, ("dense", "sparse"))
    other = replace(specs[0], config=CONFIG.model_copy(update={"episodes": 7}))
    lift = replace(specs[0], task="lift")
    assert [len(group) for group in train.groups([*specs, other, lift])] == [2, 1, 1]


def test_emptying_the_buffer_pauses_learning_until_there_is_data(tmp_path: Path) -> None:
    """The switch's first step has nothing to learn from: the networks wait instead of learning from zeros."""
    config = CONFIG.model_copy(update={"buffer": "empty"})
    [spec] = _specs(tmp_path, ("dense2sparse",), config)
    worlds = FakeWorlds(1)
    td3, buffer = TD3(config.td3, 24, 7, [0]), ReplayBuffer(1, 100, 24, 7)
    lockstep = Lockstep([spec], worlds, FakeEstimator(), td3, buffer, [RunLog(spec, 24, 7)])
    Schedule(lockstep, td3, [spec], lockstep.logs).run(Position(0, 0), Silent())
    # 5 learning episodes of 6 steps, less the first step after the switch
    assert td3.updates.item() == 5 * HORIZON - 1
