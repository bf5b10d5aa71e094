"""Learning from logged transitions alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from schemas.errors import ArtifactError
from schemas.progress import Task
from stages.policy import offline
from stages.policy.config import RunSpec, TD3Config
from stages.policy.loop import Lockstep
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.td3 import TD3, cloning_loss
from tests.policy.small_training import CONFIG, HORIZON, everything, run_specs, trained, transitions

pytestmark = pytest.mark.usefixtures("fake")


@pytest.fixture
def source(tmp_path: Path) -> RunSpec:
    [spec] = run_specs(tmp_path / "online", ("dense2sparse",))
    trained([spec])
    return spec


def learner(root: Path, source: RunSpec, **changes: object) -> RunSpec:
    config = CONFIG.model_copy(update={"warmup_episodes": 0, **changes})
    [spec] = run_specs(root, ("dense2sparse",), config)
    return replace(spec, sources=(source.out,))


def test_nothing_is_tried_out_and_everything_is_logged(source: RunSpec, tmp_path: Path) -> None:
    spec = learner(tmp_path / "offline", source)
    [result] = trained([spec])
    assert result.status == "complete"
    splits = transitions(spec)["split"].tolist()
    assert set(splits) == {"eval", "final"}
    assert splits.count("final") == CONFIG.final_episodes * HORIZON
    updates = pq.read_table(spec.out / "updates.parquet")
    assert updates["update"].to_pylist()[-1] == CONFIG.episodes * HORIZON
    evaluations = pq.read_table(spec.out / "evaluations.parquet")
    assert evaluations["after_episode"].to_pylist() == [2, 4, 6, 6]


def test_the_buffer_holds_the_training_transitions_of_all_sources(source: RunSpec) -> None:
    rows = transitions(source)
    training = rows["split"] == "train"
    assert offline.count([source.out, source.out]) == 2 * training.sum() == 2 * CONFIG.episodes * HORIZON
    buffer = ReplayBuffer(1, 200, rows["observation"].shape[1], rows["action"].shape[1])
    offline.fill(buffer, 0, [source.out])
    assert buffer.size[0] == training.sum()
    batch = buffer.sample(500, [np.random.default_rng(0)], "cpu")
    assert set(batch.reward[0].tolist()) == set(rows["reward_used"][training].astype(np.float32).tolist())


def interruption_changes_nothing(
    source: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **changes: object
) -> None:
    whole, stopped = (learner(tmp_path / name, source, **changes) for name in ("whole", "stopped"))
    trained([whole])
    learn, episodes = Lockstep.learn_episode, []

    def interrupted(self: Lockstep, episode: int, task: Task) -> None:
        episodes.append(episode)
        if episodes == [0, 1, 2, 3, 4]:
            raise KeyboardInterrupt
        learn(self, episode, task)

    monkeypatch.setattr(Lockstep, "learn_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        trained([stopped])
    trained([stopped])
    assert episodes == [0, 1, 2, 3, 4, 4, 5]  # from the checkpoint after four
    assert everything(stopped) == everything(whole)


def test_resumed_equals_uninterrupted(source: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interruption_changes_nothing(source, tmp_path, monkeypatch)


def test_the_same_sources_and_seed_give_the_same_bytes(source: RunSpec, tmp_path: Path) -> None:
    specs = [learner(tmp_path / name, source) for name in ("one", "two")]
    for spec in specs:
        trained([spec])
    one, two = map(everything, specs)
    assert one == two


def test_cloning_loss_by_hand() -> None:
    """α = 2, values 1 and −3: their mean is −1, of their sizes 2, so the value gives 1; actions are half off."""
    q, action, logged = torch.tensor([[1.0, -3.0]]), torch.full((1, 2, 1), 0.5), torch.zeros(1, 2, 1)
    assert cloning_loss(q, action, logged, 2.0).tolist() == [1.0 + 0.25]


def test_a_cloned_policy_stays_close_to_the_logged_actions(source: RunSpec, tmp_path: Path) -> None:
    near = CONFIG.td3.model_copy(
        update={"behaviour_cloning": 1e-3, "preactivation_penalty": 0.0, "learning_rate": 0.02}
    )
    free = near.model_copy(update={"behaviour_cloning": None})
    mean = transitions(source)["action"][transitions(source)["split"] == "train"].mean(axis=0)

    def off(name: str, td3: object) -> float:
        spec = learner(tmp_path / name, source, td3=td3, episodes=40, eval_every=40)
        trained([spec])
        return float(np.abs(transitions(spec)["action"].mean(axis=0) - mean).mean())

    assert off("near", near) < 0.5 * off("free", free)


def test_moments_of_observations_by_hand() -> None:
    """Two rows, 1 and 3: mean 2, deviation 1 and the least one."""
    buffer = ReplayBuffer(2, 5, 1, 1)
    column, zeros = np.array([[1.0], [3.0]], np.float32), np.zeros(2, np.float32)
    buffer.add(1, column, column, zeros, zeros, 2 * column, zeros)
    mean, deviation = buffer.moments(1)
    assert (mean.tolist(), deviation.tolist()) == ([2.0], [pytest.approx(1.001)])


def test_a_published_policy_takes_observations_as_they_are() -> None:
    rng = np.random.default_rng(0)
    td3 = TD3(TD3Config(hidden=(8,)), 3, 2, [5, 6])
    observations = rng.normal([1, 10, 100], [0.1, 1, 10], (2, 3)).astype(np.float32)
    before = td3.act(observations)
    td3.standardise(1, np.array([1, 10, 100], np.float32), np.array([0.1, 1, 10], np.float32))
    after = td3.act(observations)
    np.testing.assert_array_equal(after[0], before[0])
    for row in range(2):
        named = td3.of_raw_observations(row, td3.actor_net.named(td3.actor[row]))
        hidden = np.maximum(observations[row] @ named["0.weight"].numpy() + named["0.bias"].numpy(), 0)
        acted = np.tanh(hidden @ named["1.weight"].numpy() + named["1.bias"].numpy())
        np.testing.assert_allclose(acted, after[row], atol=1e-5)
    critic = td3.of_raw_observations(1, td3.critic_net.named(td3.critic[1, : td3.critic_net.parameters]))
    plain = td3.critic_net.named(td3.critic[1, : td3.critic_net.parameters])
    np.testing.assert_array_equal(critic["0.weight"][3:], plain["0.weight"][3:])  # actions are as they were


def test_td3_bc_resumed_equals_uninterrupted(source: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloning = {"td3": CONFIG.td3.model_copy(update={"behaviour_cloning": 2.5})}
    interruption_changes_nothing(source, tmp_path, monkeypatch, **cloning)


def test_a_source_that_has_only_evaluations(source: RunSpec, tmp_path: Path) -> None:
    from_logs = learner(tmp_path / "offline", source)
    trained([from_logs])
    with pytest.raises(ArtifactError, match="has no training transitions to learn from, only evaluations"):
        offline.count([source.out, from_logs.out])


def test_a_source_without_transitions(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="has no transitions/part-"):
        offline.count([tmp_path])
