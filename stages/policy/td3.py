"""TD3 (Fujimoto et al. 2018, algorithm 1) for many independent runs as one batched computation.

Every run keeps its own networks, optimiser and batches; nothing crosses rows. Shapes: n runs, b batch, o observation,
a action.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from stages.policy.config import TD3Config
from stages.policy.networks import StackedAdam, StackedMLP
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


class TD3:
    """Actors and twin critics of n runs, seeded by run."""

    def __init__(
        self, config: TD3Config, observation_dim: int, action_dim: int, seeds: Sequence[int], device: str = "cpu"
    ) -> None:
        self.config, self.seeds, self.device = config, list(seeds), device
        self.actor_net = StackedMLP((observation_dim, *config.hidden, action_dim))
        self.critic_net = StackedMLP((observation_dim + action_dim, *config.hidden, 1))
        n = len(self.seeds)
        self.actor = torch.zeros(n, self.actor_net.parameters, device=device)
        self.critic = torch.zeros(n, 2 * self.critic_net.parameters, device=device)  # both critics in one row
        self.actor_target, self.critic_target = torch.zeros_like(self.actor), torch.zeros_like(self.critic)
        self.actor_optimiser = StackedAdam(self.actor, config.learning_rate)
        self.critic_optimiser = StackedAdam(self.critic, config.learning_rate)
        self.updates = torch.zeros(n, 1, device=device)
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

    @torch.no_grad()
    def act(self, observations: np.ndarray) -> np.ndarray:
        """Actions (n, a) of the policies, without noise, for observations (n, o)."""
        inputs = torch.from_numpy(observations).to(self.device)[:, None].repeat(1, _ACT_ROWS, 1)
        return self._policy(self.actor, inputs)[:, 0].cpu().numpy()

    def update(self, batch: Batch, noise: Tensor, active: Tensor) -> Tensor:
        """One critic update and, every `policy_delay`-th time, one actor and target update.

        Args:
            batch: transitions of every run.
            noise: target noise before clipping (n, b, a).
            active: (n, 1) 1 where the run learns, 0 where it pauses.

        Returns:
            `METRICS` of every run (n, 6); the actor's loss is NaN where the actor was not updated.
        """
        self.updates += active
        metrics = torch.full((len(self.actor), len(METRICS)), torch.nan)
        metrics[:, [0, 1, 3, 4, 5]] = self._update_critic(batch, noise, active)
        delayed = active * (self.updates % self.config.policy_delay == 0)
        if delayed.any():
            metrics[:, 2] = torch.where(delayed[:, 0].bool(), self._update_actor(batch, delayed), torch.nan).cpu()
            self._update_targets(delayed)
        return metrics

    def _update_critic(self, batch: Batch, noise: Tensor, active: Tensor) -> Tensor:
        target = self._target(batch, noise)
        parameters = self.critic.detach().requires_grad_()
        q = self._values(parameters, batch.observation, batch.action)  # (n, 2, b)
        losses = (q - target[:, None]).square().mean(dim=2)  # (n, 2)
        (gradient,) = torch.autograd.grad(losses.sum(), parameters)
        self.critic_optimiser.step(gradient, active)
        return torch.cat([losses, q.mean(dim=2), target.mean(dim=1, keepdim=True)], dim=1).detach().cpu()

    @torch.no_grad()
    def _target(self, batch: Batch, noise: Tensor) -> Tensor:
        action = self._policy(self.actor_target, batch.next_observation)
        action = smoothed_action(action, noise, self.config.target_noise_clip)
        next_q = self._values(self.critic_target, batch.next_observation, action)
        return td_target(batch.reward, batch.terminated, next_q, self.config.gamma)

    def _update_actor(self, batch: Batch, active: Tensor) -> Tensor:
        parameters = self.actor.detach().requires_grad_()
        action = self._policy(parameters, batch.observation)
        first = self.critic[:, : self.critic_net.parameters]
        q = self.critic_net.forward(first, torch.cat([batch.observation, action], dim=2))[..., 0]
        loss = -q.mean(dim=1)  # (n,)
        (gradient,) = torch.autograd.grad(loss.sum(), parameters)
        self.actor_optimiser.step(gradient, active)
        return loss.detach()

    @torch.no_grad()
    def _update_targets(self, active: Tensor) -> None:
        tau = self.config.tau * active
        self.critic_target += (self.critic - self.critic_target) * tau
        self.actor_target += (self.actor - self.actor_target) * tau

    def _policy(self, parameters: Tensor, observations: Tensor) -> Tensor:
        return self.actor_net.forward(parameters, observations).tanh()

    def _values(self, parameters: Tensor, observations: Tensor, actions: Tensor) -> Tensor:
        """Both critics' values (n, 2, b)."""
        n, b = observations.shape[:2]
        inputs = torch.cat([observations, actions], dim=2)[:, None].expand(-1, 2, -1, -1).reshape(2 * n, b, -1)
        return self.critic_net.forward(parameters.view(2 * n, -1), inputs).view(n, 2, b)
