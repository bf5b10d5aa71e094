"""Replay memory of many runs, and what the switch of rewards does to it."""

import numpy as np
import torch

from stages.policy.td3 import Batch

_LEAST_DEVIATION = 1e-3
"""Added to standard deviations: TD3+BC's, against entries that never change."""


class ReplayBuffer:
    """One ring per run, on the CPU. Rows keep the sparse reward too, so that a switch can relabel them."""

    def __init__(self, runs: int, capacity: int, observation_dim: int, action_dim: int) -> None:
        self.capacity = capacity
        self.size = np.zeros(runs, dtype=np.int64)
        self._next = np.zeros(runs, dtype=np.int64)
        self._observation = _taken((runs, capacity, observation_dim))
        self._next_observation = _taken((runs, capacity, observation_dim))
        self._action = _taken((runs, capacity, action_dim))
        self._reward = _taken((runs, capacity))
        self._reward_sparse = _taken((runs, capacity))
        self._terminated = _taken((runs, capacity))

    def add(
        self,
        run: int,
        observation: np.ndarray,  # (k, o)
        action: np.ndarray,  # (k, a)
        reward: np.ndarray,  # (k,)
        reward_sparse: np.ndarray,  # (k,)
        next_observation: np.ndarray,  # (k, o)
        terminated: np.ndarray,  # (k,)
    ) -> None:
        """Append k transitions to a run's ring, the oldest falling out."""
        rows = (self._next[run] + np.arange(len(reward))) % self.capacity
        self._observation[run, rows], self._next_observation[run, rows] = observation, next_observation
        self._action[run, rows], self._terminated[run, rows] = action, terminated
        self._reward[run, rows], self._reward_sparse[run, rows] = reward, reward_sparse
        self._next[run] = (self._next[run] + len(reward)) % self.capacity
        self.size[run] = min(self.size[run] + len(reward), self.capacity)

    def moments(self, run: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation, (o,) float32 each, of a run's observations (TD3+BC, Fujimoto & Gu 2021, §5)."""
        seen = self._observation[run, : self.size[run]].astype(np.float64)
        mean, deviation = seen.mean(axis=0), seen.std(axis=0) + _LEAST_DEVIATION
        return mean.astype(np.float32), deviation.astype(np.float32)

    def switch(self, run: int, treatment: str) -> None:
        """What becomes of the dense rewards of a run at the switch: `keep`, `relabel` as sparse, or `empty`."""
        if treatment == "relabel":
            self._reward[run] = self._reward_sparse[run]
        elif treatment == "empty":
            self.size[run] = self._next[run] = 0

    def sample(self, batch_size: int, generators: list[np.random.Generator], device: str) -> Batch:
        """Uniformly with replacement from each run's ring, with its own random stream.

        An empty ring gives a meaningless row and draws nothing: the caller pauses that run's update.
        """
        rows = np.zeros((len(generators), batch_size), dtype=np.int64)  # (n, b)
        for run in np.flatnonzero(self.size):
            rows[run] = generators[run].integers(0, self.size[run], batch_size)
        runs = np.arange(len(rows))[:, None]

        def gather(array: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(array[runs, rows]).to(device)

        return Batch(
            observation=gather(self._observation),
            action=gather(self._action),
            reward=gather(self._reward),
            next_observation=gather(self._next_observation),
            terminated=gather(self._terminated),
        )


def _taken(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros whose memory is taken now: where it is short that shows at the start, not hours later."""
    array = np.empty(shape, dtype=np.float32)
    array.fill(0)
    return array
