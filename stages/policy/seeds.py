"""One seed tree per run: every random number follows from (run seed, stream, episode).

Nothing depends on what was drawn before, so a resumed run and a run within a matrix draw the same numbers as the same
run alone from the beginning.
"""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Branches of the tree. The numbers are part of the data contract: changing one changes every run."""

    RESET_TRAIN = 1
    RESET_EVAL = 2
    RESET_FINAL = 3
    EXPLORATION = 4
    BATCH = 5
    TARGET_NOISE = 6
    NETWORKS = 7
    SWITCH_BATCH = 8
    SWITCH_TARGET_NOISE = 9


RESET_STREAMS = {"train": Stream.RESET_TRAIN, "eval": Stream.RESET_EVAL, "final": Stream.RESET_FINAL}


def entropy(seed: int, stream: Stream, index: int) -> list[int]:
    """Seed of one branch's stream."""
    return [seed, int(stream), index]


def generator(seed: int, stream: Stream, index: int) -> np.random.Generator:
    """Random stream of one branch; `index` is the episode, or the reset's count for NETWORKS."""
    return np.random.default_rng(np.random.SeedSequence(entropy(seed, stream, index)))
