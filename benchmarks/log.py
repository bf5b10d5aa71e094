"""What logging costs: its share of the time of a real training, and bytes per transition on disk."""

import tempfile
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.measure import Stopwatch
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.training import random_estimator
from schemas.progress import Silent
from stages.policy import train
from stages.policy.config import RunConfig, RunSpec, TD3Config
from stages.policy.episode import EpisodeColumns
from stages.policy.log import RunLog
from stages.policy.parts import PART_ROWS, Parts
from stages.policy.resources import Resources
from stages.sim.config import WorldConfig

SHARE, BYTES = 0.03, 200.0
_PARTS = {
    "set": EpisodeColumns,
    "of_run": EpisodeColumns,
    "add_transitions": RunLog,
    "add": RunLog,
    "flush": RunLog,
}
_FLUSHED = 2_000  # transitions between two checkpoints


def run(quick: bool) -> Outcome:
    """Train a few runs in lockstep, dense and oracle, and count the time inside the log's methods."""
    with tempfile.TemporaryDirectory() as directory:
        specs = _specs(Path(directory), seeds=1 if quick else 3, quick=quick)
        estimator = random_estimator(Path(directory))
        watch, started = Stopwatch(), time.perf_counter()
        with watch.wrapped({name: (holder, name) for name, holder in _PARTS.items()}):
            train.run(specs, estimator, resources=Resources(processes=1), finished=lambda _: None, progress=Silent())
        seconds = time.perf_counter() - started
        parts = [path for spec in specs for path in spec.out.glob("transitions/part-*.parquet")]
        logs = [path for spec in specs for path in spec.out.glob("**/*.parquet")]
        transitions = sum(pq.read_metadata(path).num_rows for path in parts)
        stored, everything = (sum(path.stat().st_size for path in paths) for paths in (parts, logs))
        columns, filling = _columns(parts), _filling(parts, Path(directory))
    logging = sum(watch.seconds.values()) + filling * transitions
    return Outcome(
        benchmark="log",
        compares=f"{len(specs)} reach runs in lockstep with the estimator in the loop: the log's share, and its size",
        unit="environment step and run",
        targets=[
            Target("share of the training time", logging / seconds, SHARE, "", at_least=False),
            Target("bytes per transition", stored / transitions, BYTES, "bytes", at_least=False),
        ],
        figures={
            "transitions": transitions,
            "bytes per transition, all logs of a run": everything / transitions,
            "logging [µs/transition]": 1e6 * logging / transitions,
            "of it: writing the last part anew until it is full [µs/transition]": 1e6 * filling,
            "training [steps/s]": transitions / seconds,
        },
        parts=[Part(f"log ({name})", 1e3 * spent / transitions) for name, spent in watch.seconds.items()],
        table=[{"largest columns": name, "bytes per transition": size / transitions} for name, size in columns[:8]],
    )


def _filling(parts: list[Path], directory: Path) -> float:
    """Seconds a transition to fill a part by checkpoint after checkpoint: these runs are too short for that.

    Their transitions are one run's here, twice. What a short run's `flush` takes is part of it: counted twice.
    """
    tables = [pq.read_table(path, partitioning=None) for path in parts]
    rows = pa.concat_tables([table for table in tables if table.schema.equals(tables[0].schema)] * 2)
    log = Parts(directory, rows.schema)
    started = time.perf_counter()
    filled = min(PART_ROWS, rows.num_rows)
    for start in range(0, filled, _FLUSHED):
        log.append(rows.slice(start, _FLUSHED))
    return (time.perf_counter() - started) / filled


def _specs(root: Path, seeds: int, quick: bool) -> list[RunSpec]:
    """Runs of a few episodes, with as many checkpoints per episode as a study has."""
    episodes = 2 if quick else 10
    config = RunConfig(
        episodes=episodes,
        warmup_episodes=1,
        eval_every=episodes,
        eval_episodes=1,
        final_episodes=1 if quick else 5,
        checkpoint_every=episodes // 2,
        td3=TD3Config(hidden=(256, 256), batch_size=256),
    )
    world = WorldConfig(horizon=10 if quick else 200)
    cells = [(scheme, seed) for scheme in ("dense", "oracle") for seed in range(seeds)]
    specs = []
    for scheme, seed in cells:
        out = root / f"reach-{scheme}-orbit00-seed{seed}"
        out.mkdir()
        specs.append(RunSpec(f"log/{out.name}", "reach", scheme, "orbit", 0.0, seed, world, config, out))  # type: ignore[arg-type]
    return specs


def _columns(parts: list[Path]) -> list[tuple[str, int]]:
    """Compressed bytes by column, largest first."""
    sizes: dict[str, int] = {}
    for path in parts:
        metadata = pq.read_metadata(path)
        for group in range(metadata.num_row_groups):
            for index in range(metadata.num_columns):
                column = metadata.row_group(group).column(index)
                sizes[column.path_in_schema] = sizes.get(column.path_in_schema, 0) + column.total_compressed_size
    return sorted(sizes.items(), key=lambda item: -item[1])
