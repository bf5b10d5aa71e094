"""What each episode will be, derived from the seed alone: neither workers nor resuming can change a dataset."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from stages.collect.config import CollectConfig

MIN_EPISODES_TO_SPLIT = 3


class Stream(IntEnum):
    """Independent random streams of a dataset; the numbers are part of its definition."""

    BEHAVIOUR = 101
    SPLIT = 102
    KEPT_STEPS = 103
    INITIAL_STATE = 104
    CAMERA = 105
    ACTION = 106
    STRAY = 107
    LEANING = 108
    POSTURE = 109


@dataclass(frozen=True)
class EpisodePlan:
    """One episode, before it is run."""

    episode: int
    task: str  # reach | lift
    behaviour: str  # random | scripted | policy
    split: str  # train | validation | test
    leaning: bool  # whether the arm starts in a posture of its own and keeps to it
    spread: float  # half-range of the cube's start and of where it is put, in multiples of the task's
    kept_steps: tuple[int, ...]  # sorted; step k is the state after k actions
    seed: int

    @property
    def file(self) -> str:
        """Path of the episode's file in the dataset."""
        return f"episodes/episode-{self.episode:06d}.mcap"

    @property
    def identity(self) -> dict[str, str]:
        """What the metadata of the episode's file says of whose it is."""
        return {
            "episode": str(self.episode),
            "seed": str(self.seed),
            "task": self.task,
            "behaviour": self.behaviour,
            "split": self.split,
        }

    def rng(self, stream: Stream) -> np.random.Generator:
        """The episode's own generator for one purpose."""
        return _rng(self.seed, stream, self.episode)


def plan_episodes(config: CollectConfig, related: str) -> list[EpisodePlan]:
    """All episodes; `related` names the policy-related behaviour, scripted or policy."""
    behaviours, splits = _behaviours(config, related), _splits(config)
    leaning = _drawn(config, Stream.LEANING, config.leaning_fraction)
    stray = _drawn(config, Stream.STRAY, config.stray_fraction)
    return [
        EpisodePlan(
            episode=episode,
            task=config.tasks[episode % len(config.tasks)],
            behaviour=behaviours[episode],
            split=splits[episode],
            leaning=leaning[episode],
            spread=config.stray_range if stray[episode] else 1.0,
            kept_steps=_kept_steps(config, episode),
            seed=config.seed,
        )
        for episode in range(config.episodes)
    ]


def frames_per_episode(config: CollectConfig) -> int:
    """Frames kept of each episode: the fraction exactly, at least one."""
    return max(1, round(config.keep_fraction * config.steps))


def _behaviours(config: CollectConfig, related: str) -> list[str]:
    """Exactly the configured share acts at random, so that small datasets are not left to chance."""
    return ["random" if drawn else related for drawn in _drawn(config, Stream.BEHAVIOUR, config.random_fraction)]


def _drawn(config: CollectConfig, stream: Stream, fraction: float) -> list[bool]:
    """Of each episode, whether it is among the `fraction` drawn by chance."""
    order = _rng(config.seed, stream).permutation(config.episodes)
    return [bool(rank < round(fraction * config.episodes)) for rank in np.argsort(order)]


def _splits(config: CollectConfig) -> list[str]:
    """Split by episode: frames of one episode resemble each other."""
    test, validation = _split_sizes(config)
    order = _rng(config.seed, Stream.SPLIT).permutation(config.episodes)
    names = np.full(config.episodes, "train", dtype=object)
    names[order[:test]], names[order[test : test + validation]] = "test", "validation"
    return names.tolist()


def _split_sizes(config: CollectConfig) -> tuple[int, int]:
    """(test, validation) episodes; where three or more are to be split, no split that is asked for is empty."""
    total = config.episodes
    if total < MIN_EPISODES_TO_SPLIT:
        return 0, 0
    fractions = (config.test_fraction, config.validation_fraction)
    test, validation = (max(1, round(fraction * total)) if fraction > 0 else 0 for fraction in fractions)
    test = min(test, total - 2)
    return test, min(validation, total - 1 - test)


def _kept_steps(config: CollectConfig, episode: int) -> tuple[int, ...]:
    rng = _rng(config.seed, Stream.KEPT_STEPS, episode)
    return tuple(sorted(rng.choice(config.steps, frames_per_episode(config), replace=False).tolist()))


def _rng(seed: int, stream: Stream, *key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([seed, stream, *key]))
