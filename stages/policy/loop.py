"""The training loop: a list of runs stepped in lockstep, each with its own world, networks, buffer and random streams.

Worlds, estimator and TD3 are called once per step for all runs. The update during step k learns from the transitions up
to step k − 1, one update per environment step (`updates_per_step`), so it can run beside the step.
"""

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from schemas.progress import Task
from stages.policy.config import RunConfig, RunSpec
from stages.policy.episode import EpisodeColumns
from stages.policy.learner import Learner
from stages.policy.log import EpisodeHead, RunLog
from stages.policy.noise import correlated
from stages.policy.observation import observe
from stages.policy.recorder import Recorder
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.schemes import phase, reward_kind, select_reward, switches_at
from stages.policy.scoring import Scores, score
from stages.policy.seeds import RESET_STREAMS, Stream, entropy, generator
from stages.policy.summaries import episode_row, evaluation_row
from stages.policy.td3 import TD3
from stages.sim.pool import Worlds

_LEARNT_FROM = ("action", "observation", "next_observation", "reward_used")


class Estimates(Protocol):
    """Images (n, H, W, 3) uint8 → cube positions (n, 3) [m]."""

    def predict(self, images: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class _Episode:
    """One episode to roll out, of every run."""

    split: str
    number: int
    trained: int  # the training episode whose reward holds
    noise: np.ndarray  # (n, T, a)
    learning: bool = False

    @property
    def training(self) -> bool:
        return self.split == "train"

    def is_recorded(self, every: int) -> bool:
        """With its frames, when every `every`-th is."""
        return every > 0 and self.number % every == 0


class Lockstep:
    """Runs of one task and configuration, differing in scheme, misalignment, seed and what happens at the switch.

    `threads` are those of the networks; with `overlap` TD3 updates in a thread of its own while the worlds step and the
    estimator looks. Results do not depend on either.
    """

    def __init__(
        self,
        specs: Sequence[RunSpec],
        worlds: Worlds,
        estimator: Estimates | None,
        td3: TD3,
        buffer: ReplayBuffer,
        logs: Sequence[RunLog],
        threads: int = 1,
        overlap: bool = False,
        recorder: Recorder | None = None,
    ) -> None:
        self.specs, self.logs = list(specs), list(logs)
        self.config: RunConfig = specs[0].config
        self.horizon = specs[0].world.horizon
        self.errors: list[str | None] = [None] * len(specs)
        self.steps, self.seconds = 0, 0.0  # environment steps per run, and the wall time they took
        self.learning_seconds = 0.0  # wall time of updates without a step in the world
        self._worlds, self._estimator, self._td3, self._threads = worlds, estimator, td3, threads
        self._overlap, self._recorder = overlap, recorder
        self._learner = Learner(self.specs, td3, buffer, self.logs)
        self._acts_on_truth = np.array([spec.acts_on_truth for spec in specs])[:, None]
        self._columns = EpisodeColumns(len(specs), self.horizon, td3.actor_net.sizes[0], worlds.action_dim)

    @property
    def alive(self) -> list[int]:
        """Rows of the runs that have not failed."""
        return [row for row, error in enumerate(self.errors) if error is None]

    def train_episode(self, episode: int, task: Task) -> None:
        """One training episode of every run; the switch of rewards happens at its start."""
        torch.set_num_threads(self._threads)
        started = time.perf_counter()
        self._learner.begin(episode)
        self._learner.switch([row for row in self.alive if self._switches(row, episode)])
        self.learning_seconds += time.perf_counter() - started
        learning = episode >= self.config.warmup_episodes
        self._rollout(_Episode("train", episode, episode, self._exploration(episode), learning), task)
        self._fail_unlearnt(episode)

    def _switches(self, row: int, episode: int) -> bool:
        return switches_at(self.specs[row].scheme, episode, self.specs[row].config)

    def learn_episode(self, episode: int, task: Task) -> None:
        """As many updates as a training episode has steps, from what the buffers hold; no step in the world."""
        torch.set_num_threads(self._threads)
        started = time.perf_counter()
        self._learner.begin(episode)
        for step in range(self.horizon):
            self._learner.learn(self.alive, step)
        self._learner.end(self.alive)
        self._fail_unlearnt(episode)
        seconds = time.perf_counter() - started
        self.learning_seconds += seconds
        task.advance()
        task.note(f"{len(self.alive) * self.horizon / seconds:.0f} updates/s")

    def evaluate(self, split: str, first: int, count: int, after_episode: int, task: Task) -> None:
        """`count` episodes without exploration noise, logged but not learnt from."""
        noise = np.zeros((len(self.specs), self.horizon, self._worlds.action_dim), np.float32)
        for number in range(first, first + count):
            self._rollout(_Episode(split, number, max(after_episode - 1, 0), noise), task)

    def summarise_evaluation(self, split: str, first: int, count: int, after_episode: int) -> None:
        """Add the evaluation row over the episodes first … first + count − 1 to every run's log."""
        for row in self.alive:
            log = self.logs[row]
            rows = [r for r in log.rows("episodes") if r["split"] == split and first <= r["episode"] < first + count]
            index = sum(r["split"] == split for r in log.rows("evaluations"))
            log.add("evaluations", evaluation_row(split, index, after_episode, after_episode * self.horizon, rows))

    def _rollout(self, episode: _Episode, task: Task) -> None:
        started = time.perf_counter()
        stream = RESET_STREAMS[episode.split]
        self._worlds.reset([entropy(spec.seed, stream, episode.number) for spec in self.specs])
        initial = self._worlds.packed_states()
        halved = episode.learning and self._overlap  # an update and a prediction at the same time share the threads
        torch.set_num_threads(max(1, self._threads // 2) if halved else self._threads)
        with ThreadPoolExecutor(1, "learner") if halved else nullcontext() as thread:
            self._steps(episode, thread, initial)
        if not self.alive:
            return
        seconds = time.perf_counter() - started
        self.steps, self.seconds = self.steps + self.horizon, self.seconds + seconds
        self._close_episode(episode, initial, seconds)
        task.advance()
        task.note(f"{len(self.alive) * self.horizon / seconds:.0f} env steps/s")

    def _steps(self, episode: _Episode, thread: ThreadPoolExecutor | None, initial: list[np.ndarray]) -> None:
        """The steps of an episode, to its end or until no run is left."""
        random = episode.training and episode.trained < self.config.warmup_episodes
        recorder = self._recorder if episode.is_recorded(self.config.record_every) else None
        observation, estimates, _ = self._observe()
        self._see(recorder, estimates)
        for step in range(self.horizon):
            noise = episode.noise[:, step]
            policy = np.zeros_like(noise) if random else self._td3.act(observation)
            action = np.clip(policy + noise, -1, 1).astype(np.float32)
            self._worlds.start_step(action)
            if recorder:
                recorder.act(action)
            update: Future[None] | None = None
            if episode.learning and thread:
                update = thread.submit(self._learner.learn, self.alive, step)
            elif episode.learning:
                self._learner.learn(self.alive, step)
            self._worlds.finish_step()
            after, estimates, scores = self._observe()
            self._see(recorder, estimates)
            if update:
                update.result()
            used = self._used(episode.trained, scores)
            self._columns.set(step, observation=observation, next_observation=after, action=action, reward_used=used)
            self._columns.set_state(step, self._worlds.states, estimates, scores)
            if episode.training:
                self._learner.remember(self.alive, observation, action, used, scores.reward_sparse, after)
            observation = after
            self._fail_unstable(episode, step, initial)
            if not self.alive:
                return

    def _see(self, recorder: Recorder | None, estimates: np.ndarray) -> None:
        if recorder and self._worlds.frames is not None:
            recorder.see(self._worlds.states, self._worlds.frames, estimates)

    def _observe(self) -> tuple[np.ndarray, np.ndarray, Scores]:
        """Observations (n, o), estimates (n, 3) and scores of the present states."""
        states = self._worlds.states
        truth = states["cube_position"].astype(np.float32)
        if self._estimator is None or self._worlds.frames is None:
            estimates = np.full_like(truth, np.nan)
        else:
            estimates = self._estimator.predict(self._worlds.frames)
        seen = np.where(self._acts_on_truth, truth, estimates)
        observation = observe(states, seen, self.config.proprioception)
        return observation, estimates, score(self.specs[0].task, states, estimates)

    def _used(self, trained: int, scores: Scores) -> np.ndarray:
        """The reward (n,) that each run's scheme gives TD3."""
        parts = zip(scores.reward_dense_true, scores.reward_dense_est, scores.reward_sparse, strict=True)
        kinds = [reward_kind(spec.scheme, trained, spec.config) for spec in self.specs]
        chosen = [select_reward(s.scheme, k, *p) for s, k, p in zip(self.specs, kinds, parts, strict=True)]
        return np.array(chosen, dtype=np.float32)

    def _exploration(self, episode: int) -> np.ndarray:
        """Noise (n, T, a): uniform over the whole range while warming up, Gaussian after."""
        shape = (self.horizon, self._worlds.action_dim)
        streams = [generator(spec.seed, Stream.EXPLORATION, episode) for spec in self.specs]
        if episode < self.config.warmup_episodes:
            return np.stack([rng.uniform(-1, 1, shape) for rng in streams]).astype(np.float32)
        td3 = self.config.td3
        noise = [correlated(rng.standard_normal(shape), td3.exploration_correlation) for rng in streams]
        return (td3.exploration_noise * np.stack(noise)).astype(np.float32)

    def _fail_unstable(self, episode: _Episode, step: int, initial: list[np.ndarray]) -> None:
        """End runs whose simulation diverged or whose numbers are none; their neighbours go on.

        The episode up to there is kept, to be replayed.
        """
        for row in self.alive:
            if what := self._broken(row, step):
                where = f"{episode.split} episode {episode.number}, step {step}"
                self.errors[row] = f"{what} in {where}; the episode up to there is kept in failure/"
                self._keep_failure(row, episode, step + 1, initial[row])
                self._worlds.drop(row)

    def _broken(self, row: int, step: int) -> str | None:
        """What ends a run at this step; None: nothing does."""
        numbers = {name: np.isfinite(self._columns.columns[name][row, step]).all() for name in _LEARNT_FROM}
        if not numbers["action"]:
            return "the policy's action is not a number"
        if self._worlds.states["unstable"][row]:
            return "the simulation became unstable"
        return None if all(numbers.values()) else "what it observes or is rewarded with is not a number"

    def _fail_unlearnt(self, episode: int) -> None:
        """End runs whose networks hold no numbers any more, before a checkpoint keeps them; the episode is logged."""
        for row in self.alive:
            if not self._td3.is_finite(row):
                self.errors[row] = f"the networks hold values that are no numbers after train episode {episode}"
                self._worlds.drop(row)

    def _keep_failure(self, row: int, episode: _Episode, steps: int, initial: np.ndarray) -> None:
        columns = {name: values[:steps] for name, values in self._columns.of_run(row).items()}
        head, seeds = self._head(row, episode), self._seeds(row, episode)
        final = self._worlds.packed_states()[row]
        self.logs[row].keep_failure(head, columns, episode_row(head, columns, seeds, initial, final, 0.0))

    def _close_episode(self, episode: _Episode, initial: list[np.ndarray], seconds: float) -> None:
        final = self._worlds.packed_states()
        if self._recorder and episode.is_recorded(self.config.record_every):
            self._recorder.write(self.alive, episode.split, episode.number)
            self._recorder.begin()
        if episode.training:
            self._learner.end(self.alive)
        for row in self.alive:
            log, head, columns = self.logs[row], self._head(row, episode), self._columns.of_run(row)
            log.add_transitions(head, columns)
            seeds = self._seeds(row, episode)
            log.add("episodes", episode_row(head, columns, seeds, initial[row], final[row], seconds))

    def _head(self, row: int, episode: _Episode) -> EpisodeHead:
        done = episode.trained if episode.training else episode.trained + 1
        now = phase(self.specs[row].scheme, episode.trained, self.specs[row].config)
        return EpisodeHead(episode.split, episode.number, done * self.horizon, now)

    def _seeds(self, row: int, episode: _Episode) -> list[int]:
        return entropy(self.specs[row].seed, RESET_STREAMS[episode.split], episode.number)
