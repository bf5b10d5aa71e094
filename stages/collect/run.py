"""Stage `collect`: runs the robot, renders the fixed camera, records a dataset (SPEC §4)."""

import shutil
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa

from schemas.errors import MachineError
from schemas.files import failure_path, remove_halves, write_parquet
from schemas.mcap_files import make_durable
from schemas.progress import Progress
from schemas.tables import FRAMES
from stages.collect.behaviours import ActorFactory
from stages.collect.collector import Collector
from stages.collect.config import CollectStageConfig
from stages.collect.frames import EpisodeResult
from stages.collect.plan import frames_per_episode, plan_episodes
from stages.collect.workers import WorkerDiedError, collect_episodes


def run(
    config: CollectStageConfig, out: Path, *, dataset: str, actor: ActorFactory | None = None, progress: Progress
) -> dict[str, Any]:
    """Collect into `out`: episodes/*.mcap and frames.parquet. Returns the summary.

    Call again after an interruption: episode files that are whole are the checkpoint, only the others are made. With
    an `actor`, the policy-related episodes are its; without, the scripted controllers'.

    Raises:
        DivergedError: an unstable simulation. Finished episodes are kept, and in failure/ what led to it.
        MachineError: no OpenGL, a worker that died. Finished episodes are kept.
        OSError: the disk is full, or read-only. They are kept then too.
    """
    started = time.monotonic()
    (out / "episodes").mkdir(exist_ok=True)
    shutil.rmtree(failure_path(out), ignore_errors=True)  # the episode is tried again
    plans = plan_episodes(config.collect, "scripted" if actor is None else "policy")
    make = partial(Collector, config, out, dataset, actor)
    results = []
    episodes = collect_episodes(make, plans, min(config.collect.workers, len(plans)))
    half = _without_halves(out / "episodes")
    with half, progress.task("collect", total=len(plans)) as task, closing(episodes), _ended_by_request(progress):
        for result in episodes:
            results.append(result)
            task.advance()
            task.note(f"{len(results) * frames_per_episode(config.collect)} frames")
            if progress.stopping():
                raise KeyboardInterrupt
    results.sort(key=lambda result: result.plan.episode)
    make_durable(out / "episodes")
    _write_frames(results, config, out)
    return _summary(results) | {"wall_time_s": time.monotonic() - started}


@contextmanager
def _without_halves(directory: Path) -> Iterator[None]:
    """What a worker that was killed had written of an episode takes no room when the block ends."""
    try:
        yield
    finally:
        remove_halves(directory)


@contextmanager
def _ended_by_request(progress: Progress) -> Iterator[None]:
    """A supervisor's SIGTERM goes to the workers too: that they died is no failure then."""
    try:
        yield
    except WorkerDiedError as error:
        if progress.stopping():
            raise KeyboardInterrupt from error
        raise


def _write_frames(results: list[EpisodeResult], config: CollectStageConfig, out: Path) -> None:
    table = pa.Table.from_pylist([row for result in results for row in result.rows], schema=FRAMES)
    expected = config.collect.episodes * frames_per_episode(config.collect)
    if table.num_rows != expected:
        raise MachineError(f"{out} holds {table.num_rows} frames instead of {expected}: continue with --resume")
    write_parquet(table, out / "frames.parquet")


def _summary(results: list[EpisodeResult]) -> dict[str, Any]:
    return {
        "episodes": len(results),
        "frames": sum(len(result.rows) for result in results),
        "bytes": sum(result.bytes for result in results),
        "behaviours": dict(sorted(Counter(result.plan.behaviour for result in results).items())),
        "success_rate": _success_rates(results),
    }


def _success_rates(results: list[EpisodeResult]) -> dict[str, float]:
    """Share of successful episodes by BEHAVIOUR-TASK."""
    outcomes: dict[str, list[bool]] = {}
    for result in results:
        outcomes.setdefault(f"{result.plan.behaviour}-{result.plan.task}", []).append(result.success)
    return {group: sum(successes) / len(successes) for group, successes in sorted(outcomes.items())}
