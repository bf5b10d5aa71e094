"""The training loop: a list of runs stepped in lockstep, each with its own world, networks, buffer and random streams.

Worlds, estimator and TD3 are called once per step for all runs. While the worlds step, TD3 updates: the update during
step k learns from the transitions up to step k − 1, one update per environment step (`updates_per_step`).
"""

import time
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch

from schemas.progress import Task
from stages.policy.config import RunConfig, RunSpec
from stages.policy.episode import EpisodeColumns
from stages.policy.log import EpisodeHead, RunLog
from stages.policy.observation import observe
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.schemes import phase, reward_kind, select_reward, switches_at
from stages.policy.scoring import Scores, score
from stages.policy.seeds import RESET_STREAMS, Stream, entropy, generator
from stages.policy.summaries import UpdateWindow, episode_row, evaluation_row
from stages.policy.td3 import TD3
from stages.sim.pool import Worlds


class Estimates(Protocol):
    """Images (n, H, W, 3) uint8 → cube positions (n, 3) [m]."""

    def predict(self, images: np.ndarray) -> np.ndarray: ...


class Lockstep:
    """Runs of one task and one configuration, differing in scheme, misalignment and seed."""

    def __init__(
        self,
        specs: Sequence[RunSpec],
        worlds: Worlds,
        estimator: Estimates | None,
        td3: TD3,
        buffer: ReplayBuffer,
        logs: Sequence[RunLog],
    ) -> None:
        self.specs, self.logs = list(specs), list(logs)
        self.config: RunConfig = specs[0].config
        self.horizon = specs[0].world.horizon
        self.errors: list[str | None] = [None] * len(specs)
        self.steps, self.seconds = 0, 0.0  # environment steps per run, and the wall time they took
        self._worlds, self._estimator, self._td3, self._buffer = worlds, estimator, td3, buffer
        self._oracle = np.array([spec.scheme == "oracle" for spec in specs])[:, None]
        self._columns = EpisodeColumns(len(specs), self.horizon, td3.actor_net.sizes[0], worlds.action_dim)

    @property
    def alive(self) -> list[int]:
        """Rows of the runs that have not failed."""
        return [row for row, error in enumerate(self.errors) if error is None]

    def train_episode(self, episode: int, task: Task) -> None:
        """One training episode of every run; the switch of rewards happens at its start."""
        for row in self.alive:
            if switches_at(self.specs[row].scheme, episode, self.config):
                self.switch(row)
        learning = episode >= self.config.warmup_episodes
        self._rollout("train", episode, episode, self._exploration(episode), learning, task)

    def evaluate(self, split: str, first: int, count: int, after_episode: int, task: Task) -> None:
        """`count` episodes without exploration noise, logged but not learnt from."""
        noise = np.zeros((len(self.specs), self.horizon, self._worlds.action_dim), np.float32)
        for episode in range(first, first + count):
            self._rollout(split, episode, max(after_episode - 1, 0), noise, False, task)

    def summarise_evaluation(self, split: str, first: int, count: int, after_episode: int) -> None:
        """Add the evaluation row over the episodes first … first + count − 1 to every run's log."""
        for row in self.alive:
            log = self.logs[row]
            rows = [r for r in log.rows("episodes") if r["split"] == split and first <= r["episode"] < first + count]
            index = sum(r["split"] == split for r in log.rows("evaluations"))
            log.add("evaluations", evaluation_row(split, index, after_episode, after_episode * self.horizon, rows))

    def switch(self, row: int) -> None:
        """From the dense to the sparse reward: what becomes of the buffer and of the networks."""
        self._buffer.switch(row, self.config.buffer)
        if self.config.reset != "none":
            self._td3.draw(row, self.config.reset, times=1)

    def _rollout(self, split: str, episode: int, trained: int, noise: np.ndarray, learning: bool, task: Task) -> None:
        """One episode of every run; `trained` is the training episode whose reward holds, noise (n, T, a)."""
        started = time.perf_counter()
        training = split == "train"
        random = training and trained < self.config.warmup_episodes
        streams = _Streams(self.specs, episode, self.config) if learning else None
        windows = [UpdateWindow() for _ in self.specs]
        stream = RESET_STREAMS[split]
        self._worlds.reset([entropy(spec.seed, stream, episode) for spec in self.specs])
        initial = self._worlds.packed_states()
        observation = self._observe()[0]
        for step in range(self.horizon):
            policy = np.zeros_like(noise[:, step]) if random else self._td3.act(observation)
            action = np.clip(policy + noise[:, step], -1, 1).astype(np.float32)
            self._worlds.start_step(action)
            if streams:
                self._learn(streams, windows, trained, trained * self.horizon + step)
            self._worlds.finish_step()
            after, estimates, scores = self._observe()
            used = self._used(trained, scores)
            self._columns.set(step, observation=observation, next_observation=after, action=action, reward_used=used)
            self._columns.set_state(step, self._worlds.states, estimates, scores)
            if training:
                self._remember(observation, action, used, scores.reward_sparse, after)
            observation = after
            self._fail_unstable(split, episode, step)
            if not self.alive:
                return
        seconds = time.perf_counter() - started
        self.steps, self.seconds = self.steps + self.horizon, self.seconds + seconds
        self._close_episode(split, episode, trained, initial, windows, seconds)
        task.advance()
        task.note(f"{len(self.alive) * self.horizon / seconds:.0f} env steps/s")

    def _observe(self) -> tuple[np.ndarray, np.ndarray, Scores]:
        """Observations (n, o), estimates (n, 3) and scores of the present states."""
        states = self._worlds.states
        truth = states["cube_position"].astype(np.float32)
        if self._estimator is None or self._worlds.frames is None:
            estimates = np.full_like(truth, np.nan)
        else:
            estimates = self._estimator.predict(self._worlds.frames)
        seen = np.where(self._oracle, truth, estimates)
        observation = observe(states, seen, self.config.proprioception)
        return observation, estimates, score(self.specs[0].task, states, estimates)

    def _used(self, trained: int, scores: Scores) -> np.ndarray:
        """The reward (n,) that each run's scheme gives TD3."""
        parts = zip(scores.reward_dense_true, scores.reward_dense_est, scores.reward_sparse, strict=True)
        kinds = [reward_kind(spec.scheme, trained, self.config) for spec in self.specs]
        chosen = [select_reward(s.scheme, k, *p) for s, k, p in zip(self.specs, kinds, parts, strict=True)]
        return np.array(chosen, dtype=np.float32)

    def _remember(
        self, observation: np.ndarray, action: np.ndarray, used: np.ndarray, sparse: np.ndarray, after: np.ndarray
    ) -> None:
        """Into the replay buffer. The horizon is a truncation: no transition is terminal, TD3 bootstraps through it."""
        never = np.zeros(1, np.float32)
        for row in self.alive:
            one = slice(row, row + 1)
            self._buffer.add(row, observation[one], action[one], used[one], sparse[one], after[one], never)

    def _learn(self, streams: "_Streams", windows: list[UpdateWindow], trained: int, global_step: int) -> None:
        td3, buffer, config = self._td3, self._buffer, self.config
        learns = [self.errors[row] is None and buffer.size[row] > 0 for row in range(len(self.specs))]
        active = torch.tensor(learns, dtype=torch.float32, device=td3.device)[:, None]
        for _ in range(config.updates_per_step if any(learns) else 0):
            batch = buffer.sample(config.td3.batch_size, streams.batches, td3.device)
            metrics = td3.update(batch, streams.target_noise().to(td3.device), active).numpy()
            for row in np.flatnonzero(learns).tolist():
                windows[row].add(metrics[row])
                if windows[row].count == config.log_updates_every:
                    self._log_updates(row, windows[row], trained, global_step)

    def _log_updates(self, row: int, window: UpdateWindow, episode: int, global_step: int) -> None:
        head = {
            "update": int(self._td3.updates[row]),
            "global_step": global_step,
            "episode": episode,
            "phase": phase(self.specs[row].scheme, episode, self.config),
        }
        self.logs[row].add("updates", head | window.take())

    def _exploration(self, episode: int) -> np.ndarray:
        """Noise (n, T, a): uniform over the whole range while warming up, Gaussian after."""
        shape = (self.horizon, self._worlds.action_dim)
        streams = [generator(spec.seed, Stream.EXPLORATION, episode) for spec in self.specs]
        if episode < self.config.warmup_episodes:
            return np.stack([rng.uniform(-1, 1, shape) for rng in streams]).astype(np.float32)
        scale = self.config.td3.exploration_noise
        return np.stack([scale * rng.standard_normal(shape) for rng in streams]).astype(np.float32)

    def _fail_unstable(self, split: str, episode: int, step: int) -> None:
        """End runs whose simulation diverged or whose policy is no number; their neighbours go on."""
        for row in self.alive:
            diverged = not np.isfinite(self._columns.columns["action"][row, step]).all()
            if self._worlds.states["unstable"][row] or diverged:
                what = "the policy's action is not a number" if diverged else "the simulation became unstable"
                self.errors[row] = f"{what} in {split} episode {episode}, step {step}"
                self._worlds.drop(row)

    def _close_episode(
        self,
        split: str,
        episode: int,
        trained: int,
        initial: list[np.ndarray],
        windows: list[UpdateWindow],
        seconds: float,
    ) -> None:
        done = trained if split == "train" else trained + 1
        final = self._worlds.packed_states()
        for row in self.alive:
            spec, log = self.specs[row], self.logs[row]
            if windows[row].count:  # a row ends with its episode, so that a resumed run writes the same rows
                self._log_updates(row, windows[row], trained, trained * self.horizon + self.horizon - 1)
            head = EpisodeHead(split, episode, done * self.horizon, phase(spec.scheme, trained, self.config))
            columns = self._columns.of_run(row)
            log.add_transitions(head, columns)
            seeds = entropy(spec.seed, RESET_STREAMS[split], episode)
            log.add("episodes", episode_row(head, columns, seeds, initial[row], final[row], seconds))


class _Streams:
    """The random streams of one episode's updates, a generator per run."""

    def __init__(self, specs: Sequence[RunSpec], episode: int, config: RunConfig) -> None:
        self.batches = [generator(spec.seed, Stream.BATCH, episode) for spec in specs]
        self._noise = [generator(spec.seed, Stream.TARGET_NOISE, episode) for spec in specs]
        self._shape = (config.td3.batch_size, 8 if specs[0].task == "lift" else 7)
        self._scale = config.td3.target_noise

    def target_noise(self) -> torch.Tensor:
        """Noise (n, b, a) for one update, before clipping."""
        draws = [rng.standard_normal(self._shape, dtype=np.float32) for rng in self._noise]
        return torch.from_numpy(np.stack(draws) * np.float32(self._scale))
