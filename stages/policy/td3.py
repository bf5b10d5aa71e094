"""TD3 (Fujimoto et al. 2018, algorithm 1) for many independent runs as one batched computation.

Every run keeps its own networks, optimiser and batches; nothing crosses rows. Shapes: n runs, b batch, o observation,
a action.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from stages.device import arithmetic
from stages.policy.config import TD3Config
from stages.policy.networks import Layers, StackedAdam, StackedMLP
from stages.policy.seeds import Stream, generator

# Products of fewer rows take another path through the library, which rounds by the run's place in the matrix.
_ACT_ROWS = 4
METRICS = ("critic1_loss", "critic2_loss", "actor_loss", "q1_mean", "q2_mean", "target_q_mean")


class Batch(NamedTuple):
    """Transitions for one update of every run."""

    observation: Tensor  # (n, b, o)
    action: Tensor  # (n, b, a)
    reward: Tensor  # (n, b)
    next_observation: Tensor  # (n, b, o)
    terminated: Tensor  # (n, b) 1 where the state has no future; a truncation is not that


def smoothed_action(action: Tensor, noise: Tensor, clip: float) -> Tensor:
    """Target policy smoothing: action + clip(noise), within [−1, 1] (equation 14 of TD3)."""
    return (action + noise.clamp(-clip, clip)).clamp(-1, 1)


def td_target(reward: Tensor, terminated: Tensor, next_q: Tensor, gamma: float) -> Tensor:
    """r + γ (1 − terminated) min(q₁′, q₂′); `next_q` is (n, 2, b). Clipped double Q-learning."""
    return reward + gamma * (1 - terminated) * next_q.min(dim=1).values


def cloning_loss(q: Tensor, action: Tensor, logged: Tensor, alpha: float) -> Tensor:
    """TD3+BC (Fujimoto & Gu 2021, equations 3 to 5): −α q / mean|q| + (action − logged)², means over the batch: (k,).

    Values q (k, b), actions (k, b, a).
    """
    scale = alpha / q.detach().abs().mean(dim=1)
    return -scale * q.mean(dim=1) + (action - logged).square().mean(dim=2).mean(dim=1)


def annealed(config: TD3Config, progress: float) -> float:
    """Learning rate when the share `progress` in [0, 1) of the training is done: constant, then falling linearly."""
    fallen = max(0.0, 2.0 * progress - 1.0)
    return config.learning_rate * (1.0 - fallen * (1.0 - config.learning_rate_end))


class TD3:
    """Actors and twin critics of n runs, seeded by run."""

    def __init__(
        self, config: TD3Config, observation_dim: int, action_dim: int, seeds: Sequence[int], device: str = "cpu"
    ) -> None:
        self.config, self.seeds, self.device = config, list(seeds), device
        self._dtype = arithmetic(config.precision, torch.device(device))
        self.actor_net = StackedMLP((observation_dim, *config.hidden, action_dim))
        self.critic_net = StackedMLP((observation_dim + action_dim, *config.hidden, 1))
        n = len(self.seeds)
        self.actor = torch.zeros(n, self.actor_net.parameters, device=device)
        self.critic = torch.zeros(n, 2 * self.critic_net.parameters, device=device)  # both critics in one row
        self.actor_target, self.critic_target = torch.zeros_like(self.actor), torch.zeros_like(self.critic)
        self._actor_gradient, self._critic_gradient = torch.zeros_like(self.actor), torch.zeros_like(self.critic)
        self.actor_optimiser = StackedAdam(self.actor, config.learning_rate)
        self.critic_optimiser = StackedAdam(self.critic, config.learning_rate)
        self.updates = torch.zeros(n, 1)  # on the CPU: it decides what is computed
        self._mean = torch.zeros(n, 1, observation_dim, device=device)
        self._deviation = torch.ones_like(self._mean)
        for row in range(n):
            self.draw(row, "all", 0)

    def draw(self, row: int, networks: str, times: int) -> None:
        """Draw a run's networks afresh (`critics` or `all`), for the `times`-th time, with new optimiser statistics."""
        rng = generator(self.seeds[row], Stream.NETWORKS, times)
        actor = self.actor_net.initial(rng)
        critic = torch.cat([self.critic_net.initial(rng), self.critic_net.initial(rng)])
        self.critic[row] = self.critic_target[row] = critic.to(self.device)
        self.critic_optimiser.forget(row)
        if networks == "all":
            self.actor[row] = self.actor_target[row] = actor.to(self.device)
            self.actor_optimiser.forget(row)

    def standardise(self, row: int, mean: np.ndarray, deviation: np.ndarray) -> None:
        """From now on a run's networks see every observation less this mean, by this deviation; (o,) each."""
        self._mean[row], self._deviation[row] = torch.from_numpy(mean), torch.from_numpy(deviation)

    def _standardised(self, observation: Tensor) -> Tensor:
        """Observations (n, b, o) as the networks see them."""
        return (observation - self._mean) / self._deviation

    def of_raw_observations(self, row: int, network: dict[str, Tensor]) -> dict[str, Tensor]:
        """A run's network by layers (see `StackedMLP.named`) as the same function of observations as they are.

        Its first layer takes the standardisation in: (x − μ) / σ · W + b = x · W / σ + b − μ / σ · W.
        """
        weight, bias = network["0.weight"].clone(), network["0.bias"]
        mean, deviation = self._mean[row, 0], self._deviation[row, 0]
        weight[: len(mean)] /= deviation[:, None]
        return network | {"0.weight": weight, "0.bias": bias - mean @ weight[: len(mean)]}

    def is_finite(self, row: int) -> bool:
        """No number of a run's networks or of their optimisers is infinite or none at all."""
        optimisers = self.actor_optimiser, self.critic_optimiser
        every = [self.actor, self.critic, self.actor_target, self.critic_target]
        every += [values for each in optimisers for values in (each.mean, each.square)]
        return all(bool(values[row].isfinite().all()) for values in every)

    def set_learning_rate(self, rate: float) -> None:
        """Of all networks, from the next update on."""
        self.actor_optimiser.learning_rate = self.critic_optimiser.learning_rate = rate

    @torch.no_grad()
    def act(self, observations: np.ndarray) -> np.ndarray:
        """Actions (n, a) of the policies in float32, without noise, for observations (n, o)."""
        inputs = self._standardised(torch.from_numpy(observations).to(self.device)[:, None].repeat(1, _ACT_ROWS, 1))
        return self.actor_net.forward(self.actor_net.layers(self.actor), inputs).tanh()[:, 0].cpu().numpy()

    def update(
        self, batch: Batch, noise: Tensor, rows: Sequence[int] | None = None, critics_only: bool = False
    ) -> Tensor:
        """One critic update and, every `policy_delay`-th time, one actor and target update.

        Args:
            batch: transitions of every run.
            noise: target noise before clipping (n, b, a).
            rows: the runs that learn; the others pause. None: all.
            critics_only: policies and their targets stay as they are: the critics learn what these are worth.

        Returns:
            `METRICS` of every run (n, 6), NaN where there is none: of a run that pauses, of an actor's delayed update.
        """
        rows = list(range(len(self.actor)) if rows is None else rows)
        seen, next_seen = self._standardised(batch.observation), self._standardised(batch.next_observation)
        batch = batch._replace(observation=seen, next_observation=next_seen)
        metrics = torch.full((len(self.actor), len(METRICS)), torch.nan)
        self.updates[rows] += 1
        metrics[rows, :2], metrics[rows, 3:] = self._update_critic(batch, noise, rows)
        delayed = [row for row in rows if self.updates[row] % self.config.policy_delay == 0]
        if delayed and not critics_only:
            metrics[delayed, 2] = self._update_actor(batch, delayed)
            self._follow(self.actor_target, self.actor, delayed)
        self._follow(self.critic_target, self.critic, delayed)
        return metrics

    def _update_critic(self, batch: Batch, noise: Tensor, rows: list[int]) -> tuple[Tensor, Tensor]:
        """Losses (k, 2), and means of both critics' values and of the target (k, 3)."""
        batch = Batch(*(_of(values, rows) for values in batch))
        target = self._target(batch, _of(noise, rows), rows)
        layers = _leaves(self._critics(_of(self.critic, rows)))
        q = self._values(layers, batch.observation, batch.action)  # (k, 2, b)
        losses = (q - target[:, None]).square().mean(dim=2)  # (k, 2)
        gradient = self._critic_gradient[: len(rows)]
        self.critic_net.flatten(list(torch.autograd.grad(losses.sum(), layers)), gradient.view(2 * len(rows), -1))
        self.critic_optimiser.step(gradient, rows)
        return losses.detach().cpu(), torch.cat([q.mean(dim=2), target.mean(dim=1, keepdim=True)], dim=1).detach().cpu()

    @torch.no_grad()
    def _target(self, batch: Batch, noise: Tensor, rows: list[int]) -> Tensor:
        actor = self.actor_net.layers(_of(self.actor_target, rows), self._dtype)
        action = self.actor_net.forward(actor, batch.next_observation).tanh()
        action = smoothed_action(action, noise, self.config.target_noise_clip)
        next_q = self._values(self._critics(_of(self.critic_target, rows)), batch.next_observation, action)
        return td_target(batch.reward, batch.terminated, next_q, self.config.gamma)

    def _update_actor(self, batch: Batch, rows: list[int]) -> Tensor:
        """Losses (k,)."""
        observation = _of(batch.observation, rows)
        layers = _leaves(self.actor_net.layers(_of(self.actor, rows), self._dtype))
        before = self.actor_net.forward(layers, observation)  # (k, b, a)
        action = before.tanh()
        first = self.critic_net.layers(_of(self.critic, rows)[:, : self.critic_net.parameters], self._dtype)
        q = self.critic_net.forward(first, torch.cat([observation, action], dim=2))[..., 0]
        penalty = self.config.preactivation_penalty * before.square().mean(dim=2).mean(dim=1)
        loss = -q.mean(dim=1) + penalty  # (k,)
        if self.config.behaviour_cloning is not None:
            loss = penalty + cloning_loss(q, action, _of(batch.action, rows), self.config.behaviour_cloning)
        gradient = self._actor_gradient[: len(rows)]
        self.actor_net.flatten(list(torch.autograd.grad(loss.sum(), layers)), gradient)
        self.actor_optimiser.step(gradient, rows)
        return loss.detach().cpu()

    @torch.no_grad()
    def _follow(self, targets: Tensor, networks: Tensor, rows: list[int]) -> None:
        """The soft update of target networks."""
        for row in rows:
            targets[row].lerp_(networks[row], self.config.tau)

    def _critics(self, rows: Tensor) -> Layers:
        """Both critics of rows (k, 2 · parameters), as 2 k networks."""
        return self.critic_net.layers(rows.view(2 * len(rows), -1), self._dtype)

    def _values(self, critics: Layers, observations: Tensor, actions: Tensor) -> Tensor:
        """Both critics' values (k, 2, b)."""
        k, b = observations.shape[:2]
        inputs = torch.cat([observations, actions], dim=2)[:, None].expand(-1, 2, -1, -1).reshape(2 * k, b, -1)
        return self.critic_net.forward(critics, inputs).view(k, 2, b)


def _of(values: Tensor, rows: list[int]) -> Tensor:
    """These rows, without a copy where they are all."""
    return values if len(rows) == len(values) else values[rows]


def _leaves(layers: Layers) -> Layers:
    """The same numbers, to differentiate by."""
    return [layer.detach().requires_grad_() for layer in layers]
