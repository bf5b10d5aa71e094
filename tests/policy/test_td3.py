"""TD3 against its definition: targets by hand, smoothing, delay, independence of runs, and a problem it must solve."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from schemas.config import Precision
from stages.policy import td3 as td3_file
from stages.policy.config import TD3Config
from stages.policy.networks import StackedAdam, StackedMLP
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.td3 import TD3, Batch, annealed, smoothed_action, td_target

SMALL = TD3Config(hidden=(8,), batch_size=4, learning_rate=1e-2, precision="float32")


def _batch(n: int, b: int = 4, o: int = 3, a: int = 2, seed: int = 0) -> Batch:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.from_numpy(np.tile(rng.standard_normal((1, *shape)).astype(np.float32), (n, *[1] * len(shape))))

    return Batch(normal(b, o), normal(b, a).clamp(-1, 1), normal(b), normal(b, o), torch.zeros(n, b))


def _apply(net: StackedMLP, flat: torch.Tensor, inputs: torch.Tensor) -> torch.Tensor:
    return net.forward(net.layers(flat), inputs)


def test_target_by_hand() -> None:
    """r + γ min(q₁, q₂): 1 + 0.9 · 2 = 2.8; where the state is terminal only r; a truncation is not terminal."""
    reward, terminated = torch.tensor([[1.0, 1.0]]), torch.tensor([[0.0, 1.0]])
    next_q = torch.tensor([[[3.0, 3.0], [2.0, 5.0]]])
    assert torch.allclose(td_target(reward, terminated, next_q, 0.9), torch.tensor([[2.8, 1.0]]))


def test_smoothing_clips_the_noise_and_then_the_action() -> None:
    action, noise = torch.tensor([0.0, 0.9, -0.2]), torch.tensor([2.0, 0.3, -0.1])
    assert torch.allclose(smoothed_action(action, noise, clip=0.5), torch.tensor([0.5, 1.0, -0.3]))


def test_the_critics_loss_is_the_mean_squared_td_error_against_the_target_networks() -> None:
    td3, batch, noise = TD3(SMALL, 3, 2, [0]), _batch(1), torch.full((1, 4, 2), 0.1)
    width = td3.critic_net.parameters
    inputs = torch.cat([batch.observation, batch.action], dim=2)
    q = [_apply(td3.critic_net, row, inputs)[..., 0] for row in (td3.critic[:, :width], td3.critic[:, width:])]
    next_action = (_apply(td3.actor_net, td3.actor_target, batch.next_observation).tanh() + 0.1).clamp(-1, 1)
    next_inputs = torch.cat([batch.next_observation, next_action], dim=2)
    halves = (td3.critic_target[:, :width], td3.critic_target[:, width:])
    next_q = torch.minimum(*[_apply(td3.critic_net, row, next_inputs)[..., 0] for row in halves])
    target = batch.reward + 0.9 * next_q
    expected = [float((value - target).square().mean()) for value in q]
    metrics = td3.update(batch, noise)[0]
    assert metrics[:2].tolist() == pytest.approx(expected, rel=1e-5)
    assert float(metrics[3]) == pytest.approx(float(q[0].mean()), rel=1e-5)


@pytest.mark.parametrize("penalty", [0.0, 0.5])
def test_the_actors_loss_is_minus_the_first_critics_value_plus_the_penalty_on_its_output_before_tanh(
    penalty: float,
) -> None:
    """And its first step goes against the gradient of that: Adam's first step is the learning rate times its sign."""
    td3 = TD3(SMALL.model_copy(update={"policy_delay": 1, "preactivation_penalty": penalty}), 3, 2, [0])
    batch, actor = _batch(1), td3.actor.clone().requires_grad_()
    metrics = td3.update(batch, torch.zeros(1, 4, 2))[0]
    critic = td3.critic[:, : td3.critic_net.parameters]
    before = _apply(td3.actor_net, actor, batch.observation)
    q = _apply(td3.critic_net, critic, torch.cat([batch.observation, before.tanh()], dim=2))
    loss = -q.mean() + penalty * before.square().mean()
    assert float(metrics[2]) == pytest.approx(loss.item(), rel=1e-5)
    (gradient,) = torch.autograd.grad(loss, actor)
    clear = gradient.abs() > 1e-5
    step = (td3.actor - actor)[clear]
    assert clear.sum() > 20
    assert torch.allclose(step, -SMALL.learning_rate * gradient[clear].sign(), rtol=1e-2)


def test_actor_and_targets_are_updated_every_second_time() -> None:
    td3, batch = TD3(SMALL, 3, 2, [0]), _batch(1)
    moved = []
    for _ in range(4):
        before = td3.actor.clone(), td3.actor_target.clone(), td3.critic.clone()
        td3.update(batch, torch.zeros(1, 4, 2))
        after = td3.actor, td3.actor_target, td3.critic
        moved.append([not torch.equal(a, b) for a, b in zip(before, after, strict=True)])
    assert moved == [[False, False, True], [True, True, True]] * 2


def test_the_learning_rate_is_constant_and_then_falls_to_its_end() -> None:
    config = TD3Config(learning_rate=1e-2, learning_rate_end=0.1)
    assert [annealed(config, progress) for progress in (0.0, 0.5)] == [1e-2, 1e-2]
    assert annealed(config, 0.75) == pytest.approx(5.5e-3)
    assert annealed(config, 1.0) == pytest.approx(1e-3)
    assert annealed(TD3Config(learning_rate_end=1.0), 0.99) == TD3Config().learning_rate


def test_the_networks_step_by_the_learning_rate_that_is_set() -> None:
    """Adam's first step is the learning rate times the gradient's sign."""
    steps = []
    for rate in (1e-2, 1e-3):
        td3 = TD3(SMALL, 3, 2, [0])
        before = td3.critic.clone()
        td3.set_learning_rate(rate)
        td3.update(_batch(1), torch.zeros(1, 4, 2))
        steps.append(float((td3.critic - before).abs().max()))
    assert steps == pytest.approx([1e-2, 1e-3], rel=1e-3)


def test_soft_update_moves_the_target_by_tau() -> None:
    td3 = TD3(SMALL.model_copy(update={"tau": 0.25, "policy_delay": 1}), 3, 2, [0])
    before = td3.critic_target.clone()
    td3.update(_batch(1), torch.zeros(1, 4, 2))
    assert torch.allclose(td3.critic_target, 0.75 * before + 0.25 * td3.critic, atol=1e-7)


def test_adam_is_torchs_adam() -> None:
    rng = np.random.default_rng(0)
    start = torch.from_numpy(rng.standard_normal((2, 5)).astype(np.float32))
    ours, theirs = start.clone(), start.clone().requires_grad_()
    adam, reference = StackedAdam(ours, 0.01), torch.optim.Adam([theirs], lr=0.01)
    for _ in range(10):
        gradient = torch.from_numpy(rng.standard_normal((2, 5)).astype(np.float32))
        adam.step(gradient, [0, 1])
        theirs.grad = gradient
        reference.step()
    assert torch.allclose(ours, theirs, atol=1e-6)


def test_a_stacked_network_is_torchs_linear_layers() -> None:
    net = StackedMLP((3, 8, 2))
    flat = net.initial(np.random.default_rng(0))
    named = net.named(flat)
    inputs = torch.randn(1, 5, 3, generator=torch.Generator().manual_seed(0))
    hidden = (inputs @ named["0.weight"] + named["0.bias"]).relu()
    assert torch.allclose(_apply(net, flat[None], inputs), hidden @ named["1.weight"] + named["1.bias"], atol=1e-6)
    assert net.parameters == 3 * 8 + 8 + 8 * 2 + 2 + 14, "50 numbers, padded to a multiple of 16"


@pytest.mark.parametrize("sizes", [(3, 8, 2), (3, 8, 8, 1)])
def test_the_gradient_is_that_of_plain_layers(sizes: tuple[int, ...]) -> None:
    """Also through the value head, whose gradient is written out, and back into flat rows."""
    net = StackedMLP(sizes)
    flat = torch.stack([net.initial(np.random.default_rng(seed)) for seed in range(2)])
    inputs = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(0))
    layers = [layer.detach().requires_grad_() for layer in net.layers(flat)]
    ours = torch.zeros_like(flat)
    net.flatten(list(torch.autograd.grad(net.forward(layers, inputs).square().sum(), layers)), ours)
    leaf = flat.clone().requires_grad_()
    hidden, pieces = inputs, net.layers(leaf)
    for index in range(0, len(pieces), 2):
        hidden = hidden @ pieces[index] + pieces[index + 1]
        hidden = hidden.relu() if index + 2 < len(pieces) else hidden
    (theirs,) = torch.autograd.grad(hidden.square().sum(), leaf)
    assert torch.allclose(ours, theirs, atol=1e-5)


def test_bfloat16_changes_an_update_by_its_rounding_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Critic losses and values of one batch agree to the three digits of bfloat16; values are not rounded to it."""
    monkeypatch.setattr(td3_file, "arithmetic", lambda precision, device: getattr(torch, precision))  # also where slow
    exact, rounded = (TD3(TD3Config(precision=precision), 24, 7, [0]) for precision in ("float32", "bfloat16"))
    batch, noise = _batch(1, 256, 24, 7), torch.zeros(1, 256, 7)
    a, b = exact.update(batch, noise)[0], rounded.update(batch, noise)[0]
    assert b[[0, 1, 3, 4, 5]].tolist() == pytest.approx(a[[0, 1, 3, 4, 5]].tolist(), rel=0.02, abs=2e-3)
    values = rounded.critic_net.forward(
        rounded.critic_net.layers(rounded.critic[:, : rounded.critic_net.parameters], torch.bfloat16),
        torch.cat([batch.observation, batch.action], dim=2),
    )
    assert not torch.equal(values, values.bfloat16().float())


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_run_in_a_matrix_learns_as_the_same_run_alone(precision: Precision) -> None:
    """Rows do not mix: three runs together and the middle one alone end with the same networks."""
    config = TD3Config(precision=precision)
    together, alone = TD3(config, 24, 7, [5, 6, 7]), TD3(config, 24, 7, [6])
    for seed in range(4):
        together.update(_batch(3, 256, 24, 7, seed), torch.zeros(3, 256, 7))
        alone.update(_batch(1, 256, 24, 7, seed), torch.zeros(1, 256, 7))
    assert torch.equal(together.actor[1], alone.actor[0])
    assert torch.equal(together.critic_target[1], alone.critic_target[0])
    assert not torch.allclose(together.actor[0], together.actor[1])


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_runs_of_one_seed_stay_equal_bit_for_bit(precision: Precision) -> None:
    """At the real sizes: what a scheme changes is then due to its reward, not to a run's place in the matrix."""
    td3 = TD3(TD3Config(precision=precision), 24, 7, [3, 4, 3])
    for seed in range(4):
        td3.update(_batch(3, 256, 24, 7, seed), torch.full((3, 256, 7), 0.1))
    observation = np.random.default_rng(0).standard_normal((1, 24), dtype=np.float32)
    actions = td3.act(observation.repeat(3, axis=0))
    assert np.array_equal(actions[0], actions[2]) and not np.array_equal(actions[0], actions[1])
    for rows in (td3.actor, td3.critic, td3.actor_target, td3.critic_target):
        assert torch.equal(rows[0], rows[2]) and not torch.equal(rows[0], rows[1])


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_updates_do_not_depend_on_the_number_of_threads(precision: Precision) -> None:
    found, threads = [], torch.get_num_threads()
    for count in (1, 2, 3):
        torch.set_num_threads(count)
        td3 = TD3(TD3Config(precision=precision), 24, 7, [3, 4])
        for seed in range(4):
            td3.update(_batch(2, 256, 24, 7, seed), torch.full((2, 256, 7), 0.1))
        found.append([rows.clone() for rows in (td3.actor, td3.critic, td3.actor_target, td3.critic_target)])
    torch.set_num_threads(threads)
    for other in found[1:]:
        assert all(torch.equal(a, b) for a, b in zip(found[0], other, strict=True))


def test_standardised_observations_are_learnt_from_as_if_they_came_so() -> None:
    """Of one run of two, that pauses once; the other's stay as they are."""
    mean, deviation = np.array([1.0, -2.0, 0.5], np.float32), np.array([0.5, 2.0, 4.0], np.float32)
    by_td3, by_hand = TD3(SMALL, 3, 2, [0, 1]), TD3(SMALL, 3, 2, [0, 1])
    by_td3.standardise(1, mean, deviation)
    for seed, rows in ((0, [0, 1]), (1, [0]), (2, [1]), (3, [0, 1])):
        batch = _batch(2, seed=seed)
        by_td3.update(batch, torch.zeros(2, 4, 2), rows)
        for seen in (batch.observation[1], batch.next_observation[1]):
            seen -= torch.from_numpy(mean)
            seen /= torch.from_numpy(deviation)
        by_hand.update(batch, torch.zeros(2, 4, 2), rows)
    assert torch.equal(by_td3.actor, by_hand.actor) and torch.equal(by_td3.critic, by_hand.critic)


def test_a_paused_run_stays_exactly_as_it_is() -> None:
    td3 = TD3(SMALL, 3, 2, [0, 1])
    td3.update(_batch(2), torch.zeros(2, 4, 2))
    before = td3.critic[0].clone(), td3.actor_target[0].clone(), td3.critic_optimiser.mean[0].clone()
    for _ in range(3):
        td3.update(_batch(2), torch.zeros(2, 4, 2), [1])
    after = td3.critic[0], td3.actor_target[0], td3.critic_optimiser.mean[0]
    assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))
    assert td3.updates.tolist() == [[1.0], [4.0]]


def test_critics_alone_learn_what_the_policy_is_worth() -> None:
    """Where its action leaves everything as it is and earns 1, with γ = 0.5: 2. Policy and target stay as they are."""
    td3, batch = TD3(SMALL.model_copy(update={"gamma": 0.5, "tau": 0.1}), 3, 2, [0]), _batch(1)
    here = batch.observation[:, :1].expand_as(batch.observation)
    action = torch.from_numpy(td3.act(here[:, 0].numpy()))[:, None].expand_as(batch.action)
    reward, never = torch.ones_like(batch.reward), torch.zeros_like(batch.terminated)
    batch = Batch(observation=here, action=action, reward=reward, next_observation=here, terminated=never)
    actor, target, critic_target = td3.actor.clone(), td3.actor_target.clone(), td3.critic_target.clone()
    metrics = [td3.update(batch, torch.zeros(1, 4, 2), critics_only=True) for _ in range(1000)]
    assert torch.equal(td3.actor, actor) and torch.equal(td3.actor_target, target)
    assert not torch.equal(td3.critic_target, critic_target)
    assert all(torch.isnan(each[0, 2]) for each in metrics)  # no actor's loss
    assert metrics[-1][0, 3:5] == pytest.approx([2, 2], abs=0.1)


def test_drawing_afresh_gives_new_networks_and_forgets_the_optimiser() -> None:
    td3 = TD3(SMALL, 3, 2, [0, 1])
    td3.update(_batch(2), torch.zeros(2, 4, 2))
    actor, other = td3.actor[0].clone(), td3.critic[1].clone()
    old = td3.critic[0].clone()
    td3.draw(0, "critics", 1)
    assert torch.equal(td3.actor[0], actor) and torch.equal(td3.critic[1], other)
    assert not torch.allclose(td3.critic[0], old) and torch.equal(td3.critic[0], td3.critic_target[0])
    assert td3.critic_optimiser.steps[0] == 0 and not td3.critic_optimiser.square[0].any()


class TestReplayBuffer:
    def _filled(self, rewards: list[float], capacity: int = 10) -> ReplayBuffer:
        buffer = ReplayBuffer(1, capacity, 1, 1)
        values = np.array(rewards, np.float32)
        buffer.add(0, values[:, None], values[:, None], values, 10 * values, values[:, None], np.zeros(len(values)))
        return buffer

    def _rewards(self, buffer: ReplayBuffer) -> set[float]:
        return set(buffer.sample(500, [np.random.default_rng(0)], "cpu").reward[0].tolist())

    def test_samples_what_was_added(self) -> None:
        batch = self._filled([1, 2, 3]).sample(500, [np.random.default_rng(0)], "cpu")
        assert set(batch.reward[0].tolist()) == {1, 2, 3}
        assert torch.equal(batch.reward, batch.observation[..., 0]) and torch.equal(batch.reward, batch.action[..., 0])

    def test_the_oldest_fall_out(self) -> None:
        assert self._rewards(self._filled([1, 2, 3, 4, 5], capacity=3)) == {3, 4, 5}

    @pytest.mark.parametrize(("treatment", "left"), [("keep", {1, 2}), ("relabel", {10, 20}), ("empty", {7})])
    def test_the_switch(self, treatment: str, left: set[float]) -> None:
        buffer = self._filled([1, 2])
        buffer.switch(0, treatment)
        assert buffer.size[0] == (0 if treatment == "empty" else 2)
        if treatment == "empty":
            new = np.full((1, 1), 7, np.float32)
            buffer.add(0, new, new, new[0], new[0], new, np.zeros(1))
        assert self._rewards(buffer) == left

    @given(st.lists(st.integers(1, 4), min_size=1, max_size=8))
    def test_size_never_exceeds_capacity(self, chunks: list[int]) -> None:
        buffer, added = ReplayBuffer(1, 5, 1, 1), []
        for chunk in chunks:
            values = np.arange(chunk, dtype=np.float32) + len(added) + 1
            buffer.add(0, values[:, None], values[:, None], values, values, values[:, None], np.zeros(chunk))
            added += values.tolist()
        assert buffer.size[0] == min(len(added), 5)
        assert self._rewards(buffer) <= set(added[-5:])


def test_learns_a_toy_control_problem() -> None:
    """A point on a line is pushed by the action; reward 1 − |x|. The policy must bring it home from both sides."""
    config = TD3Config(hidden=(32,), batch_size=64, learning_rate=3e-3)
    td3, buffer = TD3(config, 1, 1, [0]), ReplayBuffer(1, 20_000, 1, 1)
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (4000, 1)).astype(np.float32)
    action = rng.uniform(-1, 1, (4000, 1)).astype(np.float32)
    after = np.clip(x + 0.3 * action, -1, 1)
    reward = 1 - np.abs(after[:, 0])
    buffer.add(0, x, action, reward, reward, after, np.zeros(4000))
    streams = [np.random.default_rng(1)]
    for _ in range(600):
        noise = torch.from_numpy(0.2 * streams[0].standard_normal((1, 64, 1)).astype(np.float32))
        td3.update(buffer.sample(64, streams, "cpu"), noise)
    for start in (-0.9, -0.4, 0.5, 1.0):
        position = start
        for _ in range(8):
            position = float(np.clip(position + 0.3 * td3.act(np.array([[position]], np.float32))[0, 0], -1, 1))
        assert abs(position) < 0.12, f"from {start} to {position}"
