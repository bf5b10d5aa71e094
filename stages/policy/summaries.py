"""Rows of the episode, evaluation and update tables."""

from typing import Any

import numpy as np

from stages.policy.log import EpisodeHead
from stages.policy.td3 import METRICS


def episode_row(
    head: EpisodeHead,
    columns: dict[str, np.ndarray],
    seeds: list[int],
    initial: np.ndarray,
    final: np.ndarray,
    seconds: float,
) -> dict[str, Any]:
    """Row of `episodes.parquet` from an episode's transition columns (steps, …).

    Values are rounded as the table holds them: an evaluation averages the same ones after a resume.
    """
    successes = np.flatnonzero(columns["success"])
    returns = {
        f"return_{name}": float(columns[f"reward_{name}"].sum(dtype=np.float64))
        for name in ("dense_true", "dense_est", "sparse", "used")
    }
    return {
        "split": head.split,
        "episode": head.episode,
        "global_step": head.global_step,
        "phase": head.phase,
        "length": len(columns["success"]),
        **{name: _or_none(value) for name, value in returns.items()},
        "success": bool(len(successes)),
        "steps_to_success": int(successes[0]) + 1 if len(successes) else None,
        "mean_estimation_error": _or_none(float(columns["estimation_error"].mean(dtype=np.float64).astype(np.float32))),
        "min_distance_true": float(columns["distance_true"].min()),
        "final_distance_true": float(columns["distance_true"][-1]),
        "seed_entropy": seeds,
        "initial_state": initial.tolist(),
        "final_state": final.tolist(),
        "wall_time_s": seconds,
    }


def evaluation_row(
    split: str, index: int, after_episode: int, global_step: int, episodes: list[dict[str, Any]]
) -> dict[str, Any]:
    """Row of `evaluations.parquet`: the episode reward of an evaluation is the dense true one (paper §V-D)."""
    returns = np.array([row["return_dense_true"] for row in episodes])
    errors = [row["mean_estimation_error"] for row in episodes if row["mean_estimation_error"] is not None]
    steps = [row["steps_to_success"] for row in episodes if row["steps_to_success"] is not None]
    return {
        "split": split,
        "evaluation": index,
        "after_episode": after_episode,
        "global_step": global_step,
        "phase": episodes[-1]["phase"],
        "episodes": len(episodes),
        "mean_return": float(returns.mean()),
        "std_return": float(returns.std()),
        "success_rate": float(np.mean([row["success"] for row in episodes])),
        "mean_steps_to_success": float(np.mean(steps)) if steps else None,
        "mean_estimation_error": float(np.mean(errors)) if errors else None,
    }


class UpdateWindow:
    """Means of TD3's metrics since the last row."""

    def __init__(self) -> None:
        self._values: list[np.ndarray] = []

    @property
    def count(self) -> int:
        """Updates in the window."""
        return len(self._values)

    def add(self, metrics: np.ndarray) -> None:
        """One update's `METRICS` (6,); NaN where the actor was not updated."""
        self._values.append(metrics)

    def take(self) -> dict[str, float | None]:
        """Means by name, and an empty window."""
        values, self._values = np.array(self._values, dtype=np.float64), []
        present = np.isfinite(values)
        sums = np.where(present, values, 0).sum(axis=0)
        counts = present.sum(axis=0)
        return {name: float(s / c) if c else None for name, s, c in zip(METRICS, sums, counts, strict=True)}


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else value
