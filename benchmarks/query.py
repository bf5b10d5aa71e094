"""Six questions over ten million logged transitions, as `pipeline sql` answers them."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.analyst import BARE, QUESTIONS
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.synthetic_study import FULL, SMALL, write_study

LIMIT_S, LIMIT_GB = 1.0, 2.0


def run(quick: bool) -> Outcome:
    """Write the study into a temporary directory, ask every question in fresh processes, and drop the study."""
    size, rounds = (SMALL, 1) if quick else (FULL, 3)
    with tempfile.TemporaryDirectory() as directory:
        root, started = Path(directory), time.perf_counter()
        write_study(root, size)
        written = time.perf_counter() - started
        parts = list(root.glob("runs/*/*/transitions/part-*.parquet"))
        stored = sum(part.stat().st_size for part in parts)
        _ask(root, "SELECT count(*) FROM transitions")  # modules and metadata come from the file cache from here on
        asked: dict[str, list[dict[str, Any]]] = {name: [] for name in QUESTIONS}
        bare: dict[str, list[dict[str, Any]]] = {name: [] for name in QUESTIONS}
        for _ in range(rounds):
            for name in QUESTIONS:
                asked[name].append(_ask(root, QUESTIONS[name]))
                bare[name].append(_ask(root, BARE[name]))
        opening = [_ask(root, "SELECT count(*) FROM runs") for _ in range(rounds)]
    seconds = {name: _median(answers) for name, answers in asked.items()}
    least = {name: _median(answers) for name, answers in bare.items()}
    peak = max(answer["peak_bytes"] for answers in asked.values() for answer in answers) / 1e9
    return Outcome(
        benchmark="query",
        compares=f"six questions over {size.transitions:,} transitions of {size.runs} runs, as by `pipeline sql`",
        unit="question",
        targets=[
            *(Target(name, value, LIMIT_S, "s", at_least=False) for name, value in seconds.items()),
            Target("peak memory", peak, LIMIT_GB, "GB", at_least=False),
        ],
        figures={
            "fraction of the limit": sum(least.values()) / sum(seconds.values()),
            "opening the data root, ms": 1e3 * _median(opening),
            "transitions": size.transitions,
            "part files": len(parts),
            "bytes per transition": stored / size.transitions,
            "writing the study, s": written,
        },
        parts=[Part(name, 1e3 * value, 1e3 * least[name]) for name, value in seconds.items()],
        table=[{"question": name, "rows": answers[0]["rows"]} for name, answers in asked.items()],
        notes=[
            "Each time: a fresh process, opening the data root included, starting Python excluded, files in the "
            "cache. Limit: DuckDB's bare sum over the same columns of numbers, measured in turns; a question whose "
            "filter skips row groups can be faster."
        ],
    )


def _median(answers: list[dict[str, Any]]) -> float:
    return median(answer["seconds"] for answer in answers)


def _ask(root: Path, sql: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.analyst", str(root)]
    done = subprocess.run(command, input=sql, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"a question failed: {done.stderr.strip()[-1000:]}")
    return json.loads(done.stdout)
