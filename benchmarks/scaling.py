"""How training scales: environment steps/s for more runs and more processes."""

from statistics import median
from typing import Any

from benchmarks.limits import training_limits
from benchmarks.memory import resident_mb
from benchmarks.outcome import Outcome, Part
from benchmarks.training import train
from stages.policy.resources import Resources

RUNS, PROCESSES = (1, 4, 12, 36), (1, 2)


def run(quick: bool) -> Outcome:
    """A table of rates, with the machine's limit beside them."""
    grid = [(runs, processes) for runs in ((1, 2) if quick else RUNS) for processes in PROCESSES if processes <= runs]
    limits = training_limits(2 if quick else 12)
    outcome = Outcome(
        benchmark="scaling",
        compares="environment steps/s of training with camera and estimator, by runs and by processes",
        unit="environment step of one run, parts alone on one core",
        targets=[],
        parts=[Part(name, part, limit) for name, (part, limit) in limits.parts.items()],
        cores=limits.cores,
        bare_speeds=limits.bare_speeds,
    )
    assert outcome.limit_ms is not None
    for runs, processes in grid:
        limit = 1e3 / outcome.limit_ms * processes / limits.cores
        outcome.table.append(_row(runs, processes, 1 if quick else _rounds(runs), limit))
    return outcome


def _rounds(runs: int) -> int:
    """Enough to measure: more where they are soon done."""
    return max(1, min(4, 24 // runs))


def _row(runs: int, processes: int, rounds: int, limit: float) -> dict[str, Any]:
    rates: list[float] = []
    memory: list[float] = []

    def after(episode: int, rate: float) -> None:
        if episode > 0:  # the first is without updates
            rates.append(rate)
            memory.append(resident_mb())

    train(runs, rounds, after, Resources(processes=processes, workers=0, threads=1))
    rate = median(rates)
    return {
        "runs": runs,
        "processes": processes,
        "steps/s": round(rate, 1),
        "per run": round(rate / runs, 2),
        "limit of its cores [steps/s]": round(limit, 1),
        "of limit": f"{rate / limit:.0%}",
        "memory [MB]": round(max(memory)),
    }
