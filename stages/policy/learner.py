"""What learns during an episode: replay memory, TD3 and the rows that log its updates, for all runs at once."""

from collections.abc import Sequence

import numpy as np
import torch

from stages.policy.config import RunConfig, RunSpec
from stages.policy.log import RunLog
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.schemes import phase
from stages.policy.seeds import Stream, generator
from stages.policy.summaries import UpdateWindow
from stages.policy.td3 import TD3, annealed


class Learner:
    """`begin` an episode, `learn` in each of its steps, `remember` the transition, `end` the episode."""

    def __init__(self, specs: Sequence[RunSpec], td3: TD3, buffer: ReplayBuffer, logs: Sequence[RunLog]) -> None:
        self._specs, self._td3, self._buffer, self._logs = specs, td3, buffer, logs
        self._config: RunConfig = specs[0].config
        self._horizon = specs[0].world.horizon
        self._noise_shape = (self._config.td3.batch_size, td3.actor_net.sizes[-1])

    def begin(self, episode: int) -> None:
        """Set an episode's learning rate, start its random streams, and empty the windows of what is logged."""
        self._td3.set_learning_rate(annealed(self._config.td3, episode / self._config.episodes))
        self._episode = episode
        self._batches = self._streams(Stream.BATCH, episode)
        self._noise = self._streams(Stream.TARGET_NOISE, episode)
        self._windows = [UpdateWindow() for _ in self._specs]

    def switch(self, rows: Sequence[int]) -> None:
        """From the dense to the sparse reward: what becomes of these runs' buffers and networks.

        Of the episode that has begun; without updates to catch up with, nothing but that run's networks is drawn.
        """
        for row in rows:
            config = self._specs[row].config
            self._buffer.switch(row, config.buffer)
            if config.reset != "none":
                self._td3.draw(row, config.reset, times=1)
        self._catch_up([row for row in rows if self._specs[row].config.reset != "none"])

    def _catch_up(self, rows: Sequence[int]) -> None:
        """Critics drawn afresh learn what the policy is worth, each run's as often as its configuration says.

        Logged like other updates, at the episode's first step; their rows have no actor's loss.
        """
        batches, noise = self._streams(Stream.SWITCH_BATCH, 0), self._streams(Stream.SWITCH_TARGET_NOISE, 0)
        updates = {row: self._specs[row].config.reset_updates for row in rows if self._buffer.size[row] > 0}
        for number in range(max(updates.values(), default=0)):
            learning = [row for row, count in updates.items() if number < count]
            batch = self._buffer.sample(self._config.td3.batch_size, batches, self._td3.device)
            update = self._td3.update(batch, self._target_noise(noise, learning), learning, critics_only=True)
            self._note(learning, update.numpy(), step=0)
        self._close(list(updates), step=0)

    def learn(self, rows: Sequence[int], step: int) -> None:
        """The updates of one step, of those of these runs that have something to learn from."""
        config = self._config
        rows = [row for row in rows if self._buffer.size[row] > 0]
        for _ in range(config.updates_per_step if rows else 0):
            batch = self._buffer.sample(config.td3.batch_size, self._batches, self._td3.device)
            self._note(rows, self._td3.update(batch, self._target_noise(self._noise, rows), rows).numpy(), step)

    def remember(
        self,
        rows: Sequence[int],
        observation: np.ndarray,  # (n, o)
        action: np.ndarray,  # (n, a)
        reward: np.ndarray,  # (n,)
        reward_sparse: np.ndarray,  # (n,)
        next_observation: np.ndarray,  # (n, o)
    ) -> None:
        """Add a transition of each of these runs.

        The horizon is a truncation: no transition is terminal, TD3 bootstraps through it.
        """
        never = np.zeros(1, np.float32)
        for row in rows:
            one = slice(row, row + 1)
            parts = observation[one], action[one], reward[one], reward_sparse[one], next_observation[one]
            self._buffer.add(row, *parts, never)

    def end(self, rows: Sequence[int]) -> None:
        """Log what is in the windows: a row ends with its episode, so that a resumed run writes the same rows."""
        self._close(rows, self._horizon - 1)

    def _close(self, rows: Sequence[int], step: int) -> None:
        for row in rows:
            if self._windows[row].count:
                self._log(row, step)

    def _streams(self, stream: Stream, index: int) -> list[np.random.Generator]:
        return [generator(spec.seed, stream, index) for spec in self._specs]

    def _target_noise(self, streams: Sequence[np.random.Generator], rows: Sequence[int]) -> torch.Tensor:
        """Noise (n, b, a) for one update, before clipping. The streams of runs that pause stand still."""
        noise = np.zeros((len(streams), *self._noise_shape), np.float32)
        for row in rows:
            streams[row].standard_normal(dtype=np.float32, out=noise[row])
        return torch.from_numpy(noise * np.float32(self._config.td3.target_noise)).to(self._td3.device)

    def _note(self, rows: Sequence[int], metrics: np.ndarray, step: int) -> None:
        """Add an update's `METRICS` (n, 6) to the windows of these runs; log those that are full."""
        for row in rows:
            self._windows[row].add(metrics[row])
            if self._windows[row].count == self._config.log_updates_every:
                self._log(row, step)

    def _log(self, row: int, step: int) -> None:
        spec = self._specs[row]
        head = {
            "update": int(self._td3.updates[row]),
            "global_step": self._episode * self._horizon + step,
            "episode": self._episode,
            "phase": phase(spec.scheme, self._episode, spec.config),
        }
        self._logs[row].add("updates", head | self._windows[row].take())
