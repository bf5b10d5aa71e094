"""Training with camera and estimator in the loop: 12 runs in lockstep against one stock loop at equal sizes."""

from statistics import median

from benchmarks.limits import training_limits
from benchmarks.measure import ratio
from benchmarks.memory import resident_mb
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock import StockLoop
from benchmarks.training import IMAGE_SIZE, train
from stages.policy.config import RunConfig
from stages.policy.resources import Resources

RUNS = 12


def run(quick: bool) -> Outcome:
    """Every episode of ours is followed by a stretch of stock, while ours stands still."""
    runs, rounds, stock_steps = (2, 2, 10) if quick else (RUNS, 8, 100)
    stock = StockLoop(RunConfig().td3, IMAGE_SIZE)
    rates: dict[str, list[float]] = {"ours": [], "stock": []}
    memory: list[float] = []

    def after(episode: int, rate: float) -> None:
        if episode > 0:
            rates["ours"].append(rate)
            memory.append(resident_mb(without=stock.pid))
            rates["stock"].append(stock.rate(stock_steps))

    train(runs, rounds, after, Resources(), awake=stock.pid)
    return _outcome(runs, rates, memory[:-1])  # at the end of the last, processes are ending


def _outcome(runs: int, rates: dict[str, list[float]], memory: list[float]) -> Outcome:
    limits = training_limits(runs)
    outcome = Outcome(
        benchmark="train",
        compares=f"{runs} reach runs in lockstep, 64² frames, estimator, TD3 256×256, batch 256, logs on: environment "
        "steps/s against robosuite with camera + torch ResNet34 per step + stable-baselines3 TD3",
        unit="environment step of one run, parts alone on one core",
        targets=[
            Target("ours / stock", ratio(rates, "ours", "stock"), 20.0, "×"),
            Target("memory of all processes", max(memory), 4096.0, "MB", at_least=False),
            Target(
                "its growth, first to last but one episode with updates",
                memory[-1] / memory[0] - 1,
                0.01,
                "",
                at_least=False,
            ),
        ],
        parts=[Part(name, part, limit) for name, (part, limit) in limits.parts.items()],
        cores=limits.cores,
        rounds=rates,
        bare_speeds=limits.bare_speeds,
    )
    assert outcome.limit_ms is not None
    wall = 1e3 / median(rates["ours"])
    outcome.figures.update({"wall [ms]": wall, "fraction of the limit": outcome.limit_ms / wall})
    return outcome
