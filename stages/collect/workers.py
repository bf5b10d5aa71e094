"""Episodes in this process or in several; the results are the same, in whichever order they come."""

import os
import signal
import threading
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait

from schemas.errors import MachineError
from stages.collect.collector import Collector
from stages.collect.frames import EpisodeResult
from stages.collect.plan import EpisodePlan
from stages.sim.processes import interrupts_ignored

CollectorFactory = Callable[[], Collector]
"""Makes each process's collector; picklable."""

_collector: Collector | None = None  # of this worker process


class WorkerDiedError(MachineError):
    """A worker process has ended of itself, or was killed."""


def collect_episodes(
    make: CollectorFactory, plans: list[EpisodePlan], workers: int
) -> Generator[EpisodeResult, None, None]:
    """Results as they are finished; close the generator to stop.

    Raises:
        WorkerDiedError: what it had not finished is lost.
        MachineError: an episode could not be made. Finished episodes stay on disk.
    """
    if workers == 1:
        yield from _in_this_process(make, plans)
    else:
        yield from _in_processes(make, plans, workers)


def _in_this_process(make: CollectorFactory, plans: list[EpisodePlan]) -> Generator[EpisodeResult, None, None]:
    collector = make()
    try:
        yield from map(collector.collect, plans)
    finally:
        collector.close()


def _in_processes(
    make: CollectorFactory, plans: list[EpisodePlan], workers: int
) -> Generator[EpisodeResult, None, None]:
    # spawned, not forked: a forked OpenGL context or thread pool is undefined
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    pool = ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(make, theirs))
    try:
        with interrupts_ignored(signal.SIGTERM):  # a supervisor sends it to all; this process stops the others
            futures = [pool.submit(_collect, plan) for plan in plans]  # which starts the processes
        for future in as_completed(futures):
            yield future.result()
    except BrokenProcessPool as error:
        raise WorkerDiedError(
            "a collect worker died (killed, or out of memory?); finished episodes are kept: "
            "continue with --resume, with fewer collect.workers if memory is short"
        ) from error
    except KeyboardInterrupt:  # the second, for at the first the generator is closed
        ours.close()
        raise
    finally:
        try:  # also after an error or Ctrl-C: episodes already running are finished, no others are begun
            pool.shutdown(wait=True, cancel_futures=True)
        finally:
            ours.close()
            theirs.close()


def _start_worker(make: CollectorFactory, other_end: Connection) -> None:
    global _collector
    threading.Thread(target=_end_when_closed, args=(other_end,), daemon=True).start()
    _collector = make()


def _end_when_closed(pipe: Connection) -> None:
    """End, be it in the middle of an episode, when the parent has closed its end, or is gone."""
    wait([pipe])
    os._exit(1)


def _collect(plan: EpisodePlan) -> EpisodeResult:
    assert _collector is not None, "the pool's initializer makes it"
    return _collector.collect(plan)
