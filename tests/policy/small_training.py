"""Runs of a few short episodes on fake worlds, for tests of the training loop."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.progress import Silent
from stages.policy import train
from stages.policy.config import ObservationScale, RunConfig, RunResult, RunSpec, TD3Config
from stages.policy.resources import Resources
from stages.sim.config import WorldConfig

HORIZON = 6
CONFIG = RunConfig(
    episodes=6,
    warmup_episodes=1,
    switch_episode=4,
    buffer="relabel",
    eval_every=2,
    eval_episodes=2,
    final_episodes=3,
    checkpoint_every=2,
    log_updates_every=4,
    observation_scale=ObservationScale(cube=0.15, gripper_opening=0.03, cube_to_eef=0.05),
    td3=TD3Config(hidden=(8,), batch_size=16),
)


def run_specs(root: Path, schemes: tuple[str, ...], config: RunConfig = CONFIG, seed: int = 0) -> list[RunSpec]:
    specs = []
    for scheme in schemes:
        out = root / f"reach-{scheme}-pan00-seed{seed}"
        out.mkdir(parents=True, exist_ok=True)
        world = WorldConfig(horizon=HORIZON)
        specs.append(RunSpec(f"t/{out.name}", "reach", scheme, "pan", 0.0, seed, world, config, out))  # type: ignore
    return specs


def trained(specs: list[RunSpec], estimator: bool = True) -> list[RunResult]:
    path, results = Path("estimator") if estimator else None, []
    train.run(specs, path, resources=Resources(processes=1), finished=results.append, progress=Silent())
    return results


def transitions(spec: RunSpec) -> dict[str, np.ndarray]:
    parts = sorted((spec.out / "transitions").glob("*.parquet"))
    table = pa.concat_tables(map(pq.read_table, parts))
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


def everything(spec: RunSpec) -> dict[str, object]:
    """A run's logs and weights, without wall time; parts may be cut differently, their rows not."""
    rows = transitions(spec)
    logs = {name: rows[name].tolist() for name in rows}
    for name in ("episodes", "evaluations", "updates"):
        table = pq.read_table(spec.out / f"{name}.parquet")
        logs[name] = [{k: v for k, v in row.items() if k != "wall_time_s"} for row in table.to_pylist()]
    logs["weights"] = (spec.out / "checkpoints" / "policy.safetensors").read_bytes()
    return logs
