"""TD3 updates per second and run, in lockstep: ours against stable-baselines3's at equal sizes."""

import multiprocessing
from contextlib import suppress
from multiprocessing.connection import Connection
from statistics import median

import numpy as np
import torch

from benchmarks import roofline
from benchmarks.measure import milliseconds, rate_of, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock import ACTION_DIM, OBSERVATION_DIM, filled_td3
from stages.device import arithmetic
from stages.memory import keep_freed_memory, prepare_memory_of_processes
from stages.policy.config import TD3Config
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.resources import Resources, Share
from stages.policy.td3 import TD3, Batch
from stages.sim.processes import stay_on_own_cores

RUNS = 12
TRANSITIONS = 4000  # in each replay buffer


class _Runs:
    """Our TD3 for a number of runs with filled replay buffers."""

    def __init__(self, config: TD3Config, runs: int) -> None:
        self.config, self.runs = config, runs
        self.td3 = TD3(config, OBSERVATION_DIM, ACTION_DIM, list(range(runs)))
        self.buffer = ReplayBuffer(runs, TRANSITIONS, OBSERVATION_DIM, ACTION_DIM)
        self.streams = [np.random.default_rng(run) for run in range(runs)]
        for run, rng in enumerate(self.streams):
            before, after = rng.standard_normal((2, TRANSITIONS, OBSERVATION_DIM), dtype=np.float32)
            action, zeros = rng.uniform(-1, 1, (TRANSITIONS, ACTION_DIM)), np.zeros(TRANSITIONS)
            self.buffer.add(run, before, action, zeros, zeros, after, zeros)

    def sample(self) -> Batch:
        """A batch for every run."""
        return self.buffer.sample(self.config.batch_size, self.streams, "cpu")

    def draw_noise(self) -> torch.Tensor:
        """Target noise for every run, from its own stream."""
        shape = self.config.batch_size, ACTION_DIM
        draws = [rng.standard_normal(shape, dtype=np.float32) for rng in self.streams]
        return torch.from_numpy(np.stack(draws) * np.float32(self.config.target_noise))

    def update(self) -> None:
        """Two updates, of which one moves the actor."""
        for _ in range(2):
            self.td3.update(self.sample(), self.draw_noise())


class _Processes:
    """Our TD3 for a number of runs in as many processes as training uses, each with its part of them."""

    def __init__(self, config: TD3Config, runs: int) -> None:
        context, share = multiprocessing.get_context("spawn"), Resources().share(runs)
        self.runs, self.share, self._pipes = runs, share, []
        prepare_memory_of_processes()
        for index, part in enumerate(np.array_split(np.arange(runs), share.processes)):
            pipe, theirs = context.Pipe()
            arguments = (theirs, config, len(part), index, share)
            context.Process(target=_serve, args=arguments, daemon=True).start()
            self._pipes.append(pipe)
        self.update(2)

    def update(self, updates: int) -> None:
        """So many updates of every run."""
        for pipe in self._pipes:
            pipe.send(updates)
        for pipe in self._pipes:
            pipe.recv()


def _serve(pipe: Connection, config: TD3Config, runs: int, index: int, share: Share) -> None:
    keep_freed_memory()
    stay_on_own_cores(index, share.processes)
    torch.set_num_threads(share.threads)
    ours = _Runs(config, runs)
    with suppress(EOFError):  # the parent is done
        while True:
            for _ in range(pipe.recv() // 2):
                ours.update()
            pipe.send("done")


def run(quick: bool) -> Outcome:
    """Rates for 12 runs in lockstep and for one alone, on all cores."""
    updates, rounds = (4, 2) if quick else (40, 7)
    config = TD3Config()
    exact = config.model_copy(update={"precision": "float32"})
    stock = filled_td3(config, 500 if quick else TRANSITIONS)
    together, alone, rounded = _Processes(config, RUNS), _Processes(config, 1), _Processes(exact, RUNS)
    rates = side_by_side(
        {
            "ours, 12 runs": rate_of(lambda: together.update(updates), updates * RUNS),
            "stock": rate_of(lambda: stock.train(updates, config.batch_size), updates),
            "ours, 12 runs, float32": rate_of(lambda: rounded.update(updates), updates * RUNS),
            "ours, 1 run": rate_of(lambda: alone.update(updates), updates),
        },
        rounds,
    )
    return _outcome(config, rates, together.share)


def _outcome(config: TD3Config, rates: dict[str, list[float]], share: Share) -> Outcome:
    dtype = arithmetic(config.precision, torch.device("cpu"))
    gflops = roofline.matrix_gflops(dtype)
    gflop = roofline.td3_gflop(OBSERVATION_DIM, ACTION_DIM, config.hidden, config.batch_size, config.policy_delay)
    update_ms = 1e3 / median(rates["ours, 12 runs"])
    cores = share.processes * share.threads
    part = _Runs(config, RUNS // share.processes)
    limit = gflop / gflops * 1e3
    sampling = milliseconds(part.sample) / part.runs / cores
    noise = milliseconds(part.draw_noise) / part.runs / cores
    return Outcome(
        benchmark="td3",
        compares="TD3 updates/s per run, 12 runs in lockstep, 256×256, batch 256, against stable-baselines3's TD3",
        unit="update of one run",
        targets=[Target("ours / stock", ratio(rates, "ours, 12 runs", "stock"), 3.0, "×")],
        figures={
            "float32 / stock": ratio(rates, "ours, 12 runs, float32", "stock"),
            "one run alone / stock": ratio(rates, "ours, 1 run", "stock"),
            "fraction of the limit": limit / cores / update_ms,
        },
        parts=[
            Part("sampling the batch", sampling),
            Part("target noise", noise),
            Part("update", update_ms - sampling - noise, limit / cores),
        ],
        rounds=rates,
        bare_speeds={f"matrix products, {str(dtype)[6:]}, one thread [GFLOP/s]": gflops, "update [GFLOP]": gflop},
        notes=[
            f"ours: {share.processes} processes of {share.threads} threads, stock: one of {torch.get_num_threads()}; "
            f"the update's arithmetic is {str(dtype)[6:]}, stock's float32"
        ],
    )
