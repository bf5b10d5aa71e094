"""What led to an unstable simulation, kept beside the dataset: it is no data of it, and can be simulated again."""

from pathlib import Path

import numpy as np
import pyarrow as pa

from schemas.files import failure_path, write_parquet
from schemas.tables import UNSTABLE_EPISODE
from stages.collect.plan import EpisodePlan


def keep_failure(out: Path, plan: EpisodePlan, initial_state: np.ndarray, actions: np.ndarray) -> Path:
    """Write an episode up to the action (n, action_dim) by which it became unstable; where it is kept."""
    path = failure_path(out) / f"episode-{plan.episode:06d}.parquet"
    path.parent.mkdir(exist_ok=True)
    identity = {"episode": plan.episode, "task": plan.task, "behaviour": plan.behaviour, "seed": plan.seed}
    rows = [{**identity, "step": step, "action": action.tolist()} for step, action in enumerate(actions)]
    rows[0]["initial_state"] = initial_state.tolist()
    write_parquet(pa.Table.from_pylist(rows, schema=UNSTABLE_EPISODE), path)
    return path
