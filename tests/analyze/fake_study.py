"""A data root as the stages would write it, made of random numbers that behave like the paper's curves."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from schemas import tables
from schemas.files import write_parquet
from schemas.manifest import Code, Environment, FileRef, InputRef, Manifest
from stages.analyze.studies import Study

MACHINE = Environment(
    python="3.11.9",
    platform="Linux-6.1-x86_64",
    cpu="Imaginary 9000 (2 cores)",
    gpu=None,
    gl_renderer="llvmpipe",
    packages={"torch": "2.13.0", "mujoco": "3.9.1", "numpy": "2.4.2"},
)
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


def table(rows: list[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """`rows` under `schema`; columns that a row does not name are null."""
    columns = [pa.array([row.get(field.name) for row in rows], _plain(field.type)) for field in schema]
    return pa.table(columns, names=schema.names).cast(schema)


def _plain(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_dictionary(kind) else kind


def write_manifest(
    directory: Path,
    id: str,
    config: dict[str, Any],
    summary: dict[str, Any],
    status: str = "complete",
    inputs: dict[str, Path] | None = None,
    **changes: Any,
) -> None:
    """A manifest that lists the Parquet files there are, unless `changes` says otherwise."""
    files = [] if status == "running" else [_reference(directory, path) for path in directory.rglob("*.parquet")]
    stage = {"datasets": "collect", "estimators": "train-perception", "runs": "train-policy"}[id.split("/")[0]]
    fields: dict[str, Any] = {
        "id": id,
        "stage": stage,
        "name": id.split("/")[1],
        "status": status,
        "created_at": "2026-01-02T03:04:05+00:00",
        "config": config,
        "config_sha256": hashlib.sha256(repr(config).encode()).hexdigest(),
        "inputs": [InputRef(id=key, manifest_sha256=manifest_sha256(path)) for key, path in (inputs or {}).items()],
        "code": Code(version="0.1.0", git_commit="0123456789abcdef", dirty=False),
        "environment": MACHINE,
        "files": files,
        "summary": summary,
    }
    (directory / "manifest.json").write_text(Manifest(**(fields | changes)).model_dump_json())


def _reference(directory: Path, path: Path) -> FileRef:
    data = path.read_bytes()
    name = path.relative_to(directory).as_posix()
    return FileRef(path=name, bytes=len(data), sha256=hashlib.sha256(data).hexdigest())


def manifest_sha256(directory: Path) -> str:
    """Hash of the manifest in `directory`."""
    return hashlib.sha256((directory / "manifest.json").read_bytes()).hexdigest()


def write_dataset(root: Path, name: str = "fixed-camera") -> Path:
    """A dataset of two frames."""
    directory = root / "datasets" / name
    directory.mkdir(parents=True)
    rows = [
        {"dataset": name, "episode": i, "step": 4, "time_ns": 200_000_000, "split": split, "cube_x": 0.1 * i}
        for i, split in enumerate(("train", "test"))
    ]
    write_parquet(table(rows, tables.FRAMES), directory / "frames.parquet")
    write_manifest(directory, f"datasets/{name}", {}, {"episodes": 2, "frames": 2, "bytes": 12345})
    return directory


def write_estimator(root: Path, name: str = "resnet", epochs: int = 30, dataset: Path | None = None) -> Path:
    """An estimator whose error falls with every epoch, and rises when the camera is turned."""
    rng = np.random.default_rng(1)
    directory = root / "estimators" / name
    directory.mkdir(parents=True)
    write_parquet(table(_epoch_rows(name, epochs, rng), tables.EPOCHS), directory / "epochs.parquet")
    rows = [
        {"estimator": name, "misalignment_kind": kind, "misalignment_deg": deg, "split": "test", "error": error}
        for kind, deg, scale in (("none", 0, 1.5), ("pan", 5, 6), ("pan", 10, 11), ("orbit", 5, 2.4), ("orbit", 10, 4))
        for error in scale / 100 * rng.gamma(4.0, 0.25, size=200)
    ]
    write_parquet(table(rows, tables.PREDICTIONS), directory / "predictions.parquet")
    summary = {"test_mean_error": 0.0152, "test_median_error": 0.0131, "test_p95_error": 0.031, "epochs": epochs}
    inputs = {f"datasets/{dataset.name}": dataset} if dataset else {}
    write_manifest(directory, f"estimators/{name}", {}, summary, inputs=inputs)
    return directory


def _epoch_rows(name: str, epochs: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    return [
        {
            "estimator": name,
            "epoch": epoch,
            "split": split,
            "mean_error": (floor + 0.12 * np.exp(-epoch / 6)) * rng.uniform(0.95, 1.05),
        }
        for epoch in range(1, epochs + 1)
        for split, floor in (("train", 0.006), ("validation", 0.0148))
    ]


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
    config: dict[str, Any] = {
        "world": {"cube_half_range": HALF_RANGE, "touch": "fingers"},
        "policy": {"episodes": episodes, "switch_episode": switch, "buffer": "keep", "reset": "none"},
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


def write_switch_study(root: Path, seeds: int = 3, estimator: Path | None = None) -> Study:
    """What the switch is for, beside the main runs `study`: when to switch, and what becomes of the buffer."""
    for episode, reward in ((25, 150.0), (150, 168.0)):
        for seed in range(seeds):
            outcome, settings = (reward + seed, 1.0), {"policy.switch_episode": episode, "policy.final_episodes": 50}
            name = f"study-switch-{episode}"
            write_run(root, name, degrees=10.0, seed=seed, outcome=outcome, settings=settings, estimator=estimator)
    names = ("study-switch-25", "study-switch-150")
    return Study("switch", "When should the reward switch?", ("policy.switch_episode",), names, "study")


def write_buffer_study(root: Path, seeds: int = 3, estimator: Path | None = None) -> Study:
    """What becomes of buffer and networks at the switch; the first of its variants is better than the main runs."""
    keys, variants = ("policy.buffer", "policy.reset"), {("relabel", "critics"): 190.0, ("empty", "none"): 120.0}
    for values, reward in variants.items():
        for seed in range(seeds):
            name, settings = f"study-buffer-{'-'.join(values)}", dict(zip(keys, values, strict=True))
            outcome = (reward + seed, 1.0)
            write_run(root, name, degrees=10.0, seed=seed, outcome=outcome, settings=settings, estimator=estimator)
    names = tuple(f"study-buffer-{'-'.join(values)}" for values in variants)
    return Study("buffer", "What becomes of the old dense rewards?", keys, names, "study")


def write_paper_study(root: Path, seeds: int = 3, logged_steps: int = 400, final_steps: int = 2) -> None:
    """The paper's matrix: reach at 0°, 5° and 10°, lift at 0°, four schemes; one run failed, one still runs."""
    estimator = write_estimator(root, dataset=write_dataset(root))
    settings = [("reach", 0.0), ("reach", 5.0), ("reach", 10.0), ("lift", 0.0)]
    for task, degrees in settings:
        for scheme in ("oracle", "dense2sparse", "dense", "sparse"):
            for seed in range(seeds):
                steps = {"logged_steps": logged_steps, "final_steps": final_steps}
                write_run(root, "study", task, scheme, "orbit", degrees, seed, estimator=estimator, **steps)
    write_run(root, "study", "reach", "sparse", "orbit", 10.0, seeds, status="failed", final=False, episodes=60)
    write_run(
        root, "study", "lift", "dense2sparse", "orbit", 0.0, seeds, status="running", final=False, estimator=estimator
    )
