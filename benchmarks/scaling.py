"""How training scales: environment steps/s for more runs in lockstep and more worker processes."""

from statistics import median
from typing import Any

from benchmarks.limits import training_limits
from benchmarks.memory import resident_mb
from benchmarks.outcome import Outcome, Part
from benchmarks.training import train
from stages.policy.train import Resources
from stages.sim.config import WorldConfig

RUNS, WORKERS = (1, 4, 12, 36), (1, 2)


def run(quick: bool) -> Outcome:
    """A table of rates, with the machine's limit beside them."""
    grid = [(runs, workers) for runs in ((1, 2) if quick else RUNS) for workers in WORKERS]
    limits = training_limits(2 if quick else 12)
    outcome = Outcome(
        benchmark="scaling",
        compares="environment steps/s of training with camera and estimator, by runs in lockstep and worker processes",
        unit="environment step of one run, parts alone on one core",
        targets=[],
        parts=[Part(name, part, limit) for name, (part, limit) in limits.parts.items()],
        cores=limits.cores,
        bare_speeds=limits.bare_speeds,
    )
    assert outcome.limit_ms is not None
    limit = 1e3 / outcome.limit_ms
    outcome.table.extend(_row(runs, workers, 2 if quick else _episodes(runs), limit) for runs, workers in grid)
    return outcome


def _episodes(runs: int) -> int:
    """Enough to measure: a few hundred steps of each run, more where they are soon done."""
    return 3 if runs >= 12 else 5


def _row(runs: int, workers: int, episodes: int, limit: float) -> dict[str, Any]:
    rates: list[float] = []
    memory: list[float] = []

    def after(episode: int, seconds: float) -> None:
        if episode > 1:  # the first is without updates
            rates.append(runs * WorldConfig().horizon / seconds)
            memory.append(resident_mb())

    train(runs, episodes, after, resources=Resources(workers=workers))
    rate = median(rates)
    return {
        "runs": runs,
        "workers": workers,
        "steps/s": round(rate, 1),
        "per run": round(rate / runs, 2),
        "limit [steps/s]": round(limit, 1),
        "of limit": f"{rate / limit:.0%}",
        "memory [MB]": round(max(memory)),
    }
