"""Training with camera and estimator in the loop: 12 runs in lockstep against one stock loop at equal sizes."""

import time
from collections.abc import Callable
from statistics import median

import torch

from benchmarks.limits import training_limits
from benchmarks.measure import Stopwatch, ratio
from benchmarks.memory import resident_mb
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock import CameraReach, make_td3
from benchmarks.training import IMAGE_SIZE, train
from stages.perception.estimator import Estimator
from stages.policy.config import RunConfig
from stages.policy.log import RunLog
from stages.policy.loop import Lockstep
from stages.policy.td3 import TD3
from stages.policy.train import Resources
from stages.sim.config import WorldConfig

RUNS = 12
_WAITED_FOR = {  # what the main process does, by the method that does it
    "acting": (TD3, "act"),
    "update": (TD3, "update"),
    "inference": (Estimator, "predict"),
    "log": (RunLog, "flush"),
    "log, end of episode": (Lockstep, "_close_episode"),
}


def run(quick: bool) -> Outcome:
    """Every episode of ours is followed by a stretch of stock in the same process, while ours stands still."""
    runs, rounds, stock_steps = (2, 2, 10) if quick else (RUNS, 6, 100)
    stock = _stock(stock_steps)
    rates: dict[str, list[float]] = {"ours": [], "stock": []}
    memory: list[float] = []
    watch = Stopwatch()
    steps = runs * WorldConfig().horizon

    def after(episode: int, seconds: float) -> None:
        if episode == 1:  # without updates
            stock()
            watch.seconds.clear()
            return
        rates["ours"].append(steps / seconds)
        rates["stock"].append(stock())
        memory.append(resident_mb())

    with watch.wrapped(_WAITED_FOR):
        train(runs, 1 + rounds, after, resources=Resources())
    return _outcome(runs, rates, watch, memory)


def _stock(steps: int) -> Callable[[], float]:
    """The stock loop, past its random start; a call trains for some steps and returns its rate."""
    environment = CameraReach(WorldConfig(), IMAGE_SIZE)
    model = make_td3(environment, RunConfig().td3, learning_starts=10)
    model.learn(20)

    def rate() -> float:
        threads = torch.get_num_threads()
        torch.set_num_threads(_default_threads)  # as the user has them, not as our training set them
        started = time.perf_counter()
        model.learn(steps, reset_num_timesteps=False)
        seconds = time.perf_counter() - started
        torch.set_num_threads(threads)
        return steps / seconds

    return rate


_default_threads = torch.get_num_threads()


def _outcome(runs: int, rates: dict[str, list[float]], watch: Stopwatch, memory: list[float]) -> Outcome:
    wall = 1e3 / median(rates["ours"])
    count = len(rates["ours"]) * runs * WorldConfig().horizon
    limits = training_limits(runs)
    outcome = Outcome(
        benchmark="train",
        compares=f"{runs} reach runs in lockstep, 64² frames, estimator, TD3 256×256, batch 256, logs on: environment "
        "steps/s against robosuite with camera + torch ResNet34 per step + stable-baselines3 TD3",
        unit="environment step of one run",
        targets=[
            Target("ours / stock", ratio(rates, "ours", "stock"), 20.0, "×"),
            Target("memory of all processes", max(memory), 4096.0, "MB", at_least=False),
            Target("growth of memory, first to last episode", memory[-1] / memory[0] - 1, 0.01, "", at_least=False),
        ],
        figures={f"main process, {name} [ms]": 1e3 * s / count for name, s in sorted(watch.seconds.items())},
        parts=[Part(name, part, limit) for name, (part, limit) in limits.parts.items()],
        cores=limits.cores,
        rounds=rates,
        bare_speeds=limits.bare_speeds,
    )
    assert outcome.limit_ms is not None
    outcome.figures["wall [ms]"] = wall
    outcome.figures["fraction of the limit"] = outcome.limit_ms / wall
    return outcome
