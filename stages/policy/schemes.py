"""Which reward trains the agent when (paper §VI: Dense, Sparse, Oracle, Dense2Sparse)."""

import numpy as np

from stages.policy.config import RunConfig, Scheme


def reward_kind(scheme: Scheme, episode: int, config: RunConfig) -> str:
    """`dense` or `sparse`: the reward of training episode `episode` (counted from 0)."""
    if scheme == "dense2sparse":
        return "sparse" if episode >= config.switch_episode else "dense"
    return "sparse" if scheme == "sparse" else "dense"


def phase(scheme: Scheme, episode: int, config: RunConfig) -> str:
    """`warmup` while actions are random and nothing is learnt, else the kind of reward."""
    return "warmup" if episode < config.warmup_episodes else reward_kind(scheme, episode, config)


def switches_at(scheme: Scheme, episode: int, config: RunConfig) -> bool:
    """Whether the reward changes at the start of this episode."""
    return scheme == "dense2sparse" and episode == config.switch_episode


def select_reward(
    scheme: Scheme, kind: str, dense_true: np.ndarray, dense_est: np.ndarray, sparse: np.ndarray
) -> np.ndarray:
    """What TD3 is given: the oracle's dense reward is the true one, everyone else's the estimated one."""
    if kind == "sparse":
        return sparse
    return dense_true if scheme == "oracle" else dense_est
