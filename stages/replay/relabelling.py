"""Which of an episode's logged rewards a scheme gives TD3: a choice of columns, not a second formula (SPEC §5)."""

from typing import Any

import numpy as np

Rows = dict[str, np.ndarray]


def trained_episode(rows: Rows, horizon: int) -> np.ndarray:
    """Training episode (n,) whose reward holds in each row: its own, or the last one before an evaluation."""
    evaluated = np.maximum(rows["global_step"] // horizon - 1, 0)
    return np.where(rows["split"] == "train", rows["episode"], evaluated)


def sparse_holds(scheme: str, trained: np.ndarray, switch_episode: int) -> np.ndarray:
    """Where (n,) the scheme gives the sparse reward."""
    if scheme == "dense2sparse":
        return trained >= switch_episode
    return np.full(len(trained), scheme == "sparse")


def reward_of(scheme: str, rows: Rows, sparse: np.ndarray) -> np.ndarray:
    """What the scheme gives TD3 (n,): the oracle's dense reward is the true one, everyone else's the estimated one."""
    dense = rows["reward_dense_true"] if scheme == "oracle" else rows["reward_dense_est"]
    return np.where(sparse, rows["reward_sparse"], dense)


def acts_on_truth(config: dict[str, Any]) -> bool:
    """Whether the policy of a run's configuration observes the cube's true position, not an estimate."""
    return config["run"]["scheme"] == "oracle" and config["policy"].get("oracle_sees", "truth") == "truth"


def used(config: dict[str, Any], rows: Rows) -> np.ndarray:
    """What TD3 is given (n,) under the scheme and the switch of a run's configuration."""
    scheme, trained = config["run"]["scheme"], trained_episode(rows, config["world"]["horizon"])
    return reward_of(scheme, rows, sparse_holds(scheme, trained, config["policy"]["switch_episode"]))


def phases(config: dict[str, Any], rows: Rows) -> np.ndarray:
    """`warmup`, `dense` or `sparse` (n,): which reward trains the agent in each row."""
    scheme, trained = config["run"]["scheme"], trained_episode(rows, config["world"]["horizon"])
    sparse = sparse_holds(scheme, trained, config["policy"]["switch_episode"])
    kinds = np.where(sparse, "sparse", "dense")
    return np.where(trained < config["policy"]["warmup_episodes"], "warmup", kinds)
