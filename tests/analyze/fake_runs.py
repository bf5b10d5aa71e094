"""Runs as training would write them, made of random numbers that behave like the paper's curves."""

from pathlib import Path
from typing import Any

import numpy as np

from schemas import tables
from schemas.files import write_parquet
from tests.analyze.fake_artifacts import table, write_manifest

HALF_RANGE = 0.15  # of the cube's position [m]
FINAL = {  # task, scheme: final return at 0°, loss per degree, success at 0°, loss of success per degree
    ("reach", "oracle"): (178, 0.0, 1.0, 0.0),
    ("reach", "dense2sparse"): (174, 0.3, 1.0, 0.001),
    ("reach", "dense"): (164, 6.0, 0.99, 0.02),
    ("reach", "sparse"): (118, 6.5, 0.94, 0.062),
    ("lift", "oracle"): (352, 0.0, 0.99, 0.0),
    ("lift", "dense2sparse"): (346, 0.0, 0.98, 0.0),
    ("lift", "dense"): (258, 0.0, 0.65, 0.0),
    ("lift", "sparse"): (255, 0.0, 0.6, 0.0),
}


def write_run(
    root: Path,
    name: str = "study",
    task: str = "reach",
    scheme: str = "dense2sparse",
    kind: str = "orbit",
    degrees: float = 0.0,
    seed: int = 0,
    *,
    episodes: int = 300,
    switch: int = 100,
    status: str = "complete",
    final: bool = True,
    estimator: Path | None = None,
    logged_steps: int = 400,
    final_steps: int = 0,
    outcome: tuple[float, float] | None = None,
    settings: dict[str, Any] | None = None,
) -> Path:
    """A run with an evaluation every 20 episodes, and `logged_steps` steps of transitions in parts of one episode.

    `outcome` sets episode reward and success rate of the last evaluation, which are drawn at random otherwise;
    `final_steps` are logged of each final episode; `settings` are dotted keys of its configuration that differ.
    """
    rng = np.random.default_rng([seed, int(degrees), *map(ord, task + scheme)])
    cell = f"{task}-{scheme}-{kind}{degrees:02.0f}-seed{seed}"
    directory = root / "runs" / name / cell
    (directory / "transitions").mkdir(parents=True)
    identity = {"task": task, "scheme": scheme, "misalignment_kind": kind, "misalignment_deg": degrees, "seed": seed}
    columns = {"run": f"{name}/{cell}", **identity}
    evaluations = _evaluations(task, scheme, degrees, episodes, switch, final, rng)
    if outcome:
        evaluations[-1] |= dict(zip(("mean_return", "success_rate"), outcome, strict=True))
    write_parquet(table([columns | row for row in evaluations], tables.EVALUATIONS), directory / "evaluations.parquet")
    rows = _episodes(evaluations, episodes, switch if scheme == "dense2sparse" else episodes, degrees, seed, rng)
    write_parquet(table([columns | row for row in rows], tables.EPISODES), directory / "episodes.parquet")
    _write_transitions(directory, columns, 8 if task == "lift" else 7, degrees, logged_steps, rng)
    if final_steps:
        _write_final_steps(directory, columns, 8 if task == "lift" else 7, degrees, rows, final_steps)
    gamma, noise = (0.97, 0.3) if task == "lift" else (0.9, 0.2)
    config: dict[str, Any] = {
        "world": {"robot": "Panda", "cube_half_range": HALF_RANGE, "touch": "fingers"},
        "policy": {
            **{"episodes": episodes, "switch_episode": switch, "buffer": "keep", "reset": "none"},
            "td3": {"gamma": gamma, "exploration_noise": noise, "preactivation_penalty": 0.1},
        },
        "run": identity,
        "estimator": estimator.name if estimator else None,
    }
    for key, value in (settings or {}).items():
        section, _, name_of = key.partition(".")
        config[section][name_of] = value
    summary = {"episodes": episodes, "global_steps": 200 * episodes, "final_return": evaluations[-1]["mean_return"]}
    inputs = {f"estimators/{estimator.name}": estimator} if estimator else {}
    write_manifest(directory, f"runs/{name}/{cell}", config, summary, status, inputs)
    return directory


def _evaluations(
    task: str, scheme: str, degrees: float, episodes: int, switch: int, final: bool, rng: np.random.Generator
) -> list[dict[str, Any]]:
    top, per_degree, success, lost = FINAL[task, scheme]
    level = (top - per_degree * degrees) * rng.normal(1.0, 0.01 + 0.003 * per_degree)
    level = min(level, 195 if task == "reach" else 430)
    slow = {"sparse": 90.0}.get(scheme, 35.0)
    rows = []
    for number, after in enumerate(range(20, episodes + 1, 20)):
        rows.append(
            {
                "split": "eval",
                "evaluation": number,
                "after_episode": after,
                "phase": "sparse" if scheme == "sparse" or (scheme == "dense2sparse" and after > switch) else "dense",
                "episodes": 5,
                "mean_return": max(4.0, level * (1 - np.exp(-after / slow)) + rng.normal(0, 0.02 * top)),
                "success_rate": float(rng.binomial(5, min(1.0, success * (1 - np.exp(-after / slow)))) / 5),
                "mean_estimation_error": 0.015 + 0.0025 * degrees,
            }
        )
    share = float(np.clip(success - lost * degrees + rng.normal(0, 0.08 * (1 - success + lost * degrees)), 0, 1))
    last = {"split": "final", "evaluation": 0, "episodes": 1000, "mean_return": level, "success_rate": share}
    return [*rows, rows[-1] | last | {"mean_steps_to_success": 31.0 + degrees}] if final else rows


def _episodes(
    evaluations: list[dict[str, Any]], episodes: int, switch: int, degrees: float, seed: int, rng: np.random.Generator
) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = [
        {"split": "train", "episode": i, "phase": "dense" if i < switch else "sparse", "return_dense_true": 50.0 + i}
        for i in range(episodes)
    ]
    rows += [
        {
            "split": "final",
            "episode": i,
            "return_dense_true": evaluations[-1]["mean_return"] + float(rng.normal(0, 9)),
            "mean_estimation_error": 0.01 + 0.002 * degrees * (1 + start(seed, i)[0] / HALF_RANGE),
        }
        for i in range(10 if evaluations[-1]["split"] == "final" else 0)
    ]
    return [row | {"length": 200, "success": row["return_dense_true"] > 100, "wall_time_s": 1.5} for row in rows]


def _write_transitions(
    directory: Path, columns: dict[str, Any], actions: int, degrees: float, steps: int, rng: np.random.Generator
) -> None:
    schema = tables.transitions(4, actions)
    for part in range(steps // 200):
        distance = rng.uniform(0.0, 0.4, 200).astype(np.float32)
        estimated = np.abs(distance + rng.normal(0, 0.01 + 0.003 * degrees, 200)).astype(np.float32)
        rows = [
            columns
            | {"split": "train", "episode": part, "step": step, "observation": [0.0] * 4, "action": [0.5] * actions}
            | {"distance_true": true, "distance_est": est, "estimation_error": abs(true - est)}
            | {"reward_dense_true": 1 - np.tanh(10 * true), "reward_dense_est": 1 - np.tanh(10 * est)}
            for step, (true, est) in enumerate(zip(distance.tolist(), estimated.tolist(), strict=True))
        ]
        write_parquet(table(rows, schema), directory / "transitions" / f"part-{part:05d}.parquet")


def start(seed: int, episode: int) -> tuple[float, float]:
    """Where the cube of a final episode starts [m]: the same in every scheme."""
    x, y = np.random.default_rng([seed, episode]).uniform(-HALF_RANGE, HALF_RANGE, 2)
    return float(x), float(y)


def _write_final_steps(
    directory: Path, columns: dict[str, Any], actions: int, degrees: float, episodes: list[dict[str, Any]], steps: int
) -> None:
    rows = []
    for episode in (row for row in episodes if row["split"] == "final"):
        x, y = start(columns["seed"], episode["episode"])
        rows += [
            columns
            | {"split": "final", "episode": episode["episode"], "step": step, "cube_true_x": x, "cube_true_y": y}
            | {"reward_dense_true": 0.8, "reward_dense_est": 0.8 - 4 * episode["mean_estimation_error"]}
            | {"distance_true": 0.02, "observation": [0.0] * 4, "action": [0.5] * actions}
            for step in range(steps)
        ]
    write_parquet(table(rows, tables.transitions(4, actions)), directory / "transitions" / "part-90000.parquet")
