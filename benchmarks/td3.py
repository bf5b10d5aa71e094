"""TD3 updates per second and run, in lockstep: ours against stable-baselines3's at equal sizes."""

from statistics import median

import numpy as np
import torch

from benchmarks import roofline
from benchmarks.measure import milliseconds, rate_of, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock import ACTION_DIM, OBSERVATION_DIM, filled_td3
from stages.device import arithmetic
from stages.memory import keep_freed_memory
from stages.policy.config import TD3Config
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.td3 import TD3, Batch

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
        self.batch, self.noise = self.sample(), self.draw_noise()

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


def run(quick: bool) -> Outcome:
    """Rates for 12 runs in lockstep and for one alone, on all cores."""
    updates, rounds = (4, 2) if quick else (40, 7)
    keep_freed_memory()
    config = TD3Config()
    stock = filled_td3(config, 500 if quick else TRANSITIONS)
    together, alone = _Runs(config, RUNS), _Runs(config, 1)
    exact = _Runs(config.model_copy(update={"precision": "float32"}), RUNS)

    def repeated(runs: _Runs) -> None:
        for _ in range(updates // 2):
            runs.update()

    rates = side_by_side(
        {
            "ours, 12 runs": rate_of(lambda: repeated(together), updates * RUNS),
            "stock": rate_of(lambda: stock.train(updates, config.batch_size), updates),
            "ours, 12 runs, float32": rate_of(lambda: repeated(exact), updates * RUNS),
            "ours, 1 run": rate_of(lambda: repeated(alone), updates),
        },
        rounds,
    )
    return _outcome(config, rates, together)


def _outcome(config: TD3Config, rates: dict[str, list[float]], together: _Runs) -> Outcome:
    dtype = arithmetic(config.precision, torch.device("cpu"))
    gflops = roofline.matrix_gflops(dtype)
    gflop = roofline.td3_gflop(OBSERVATION_DIM, ACTION_DIM, config.hidden, config.batch_size, config.policy_delay)
    update_ms = 1e3 / median(rates["ours, 12 runs"])
    cores = torch.get_num_threads()
    limit = gflop / gflops * 1e3
    sampling = milliseconds(together.sample) / RUNS
    noise = milliseconds(together.draw_noise) / RUNS
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
            Part("update", update_ms - sampling - noise, limit),
        ],
        cores=cores,
        rounds=rates,
        bare_speeds={f"matrix products, {str(dtype)[6:]}, one thread [GFLOP/s]": gflops, "update [GFLOP]": gflop},
        notes=[f"both on {cores} threads; the update's arithmetic is {str(dtype)[6:]}, stock's float32"],
    )
