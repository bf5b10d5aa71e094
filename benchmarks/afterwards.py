"""What is asked after the fact: an episode viewed, an episode replayed, a study of 36 runs analysed."""

import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median

from benchmarks.outcome import Outcome, Part, Target
from benchmarks.synthetic_study import StudySize, write_study

VIEW_S, REPLAY_STEPS_S, ANALYSIS_S, ANALYSIS_GB = 3.0, 500.0, 60.0, 2.0
REACH = (("reach", 0.0), ("reach", 5.0), ("reach", 10.0))
FULL = StudySize(seeds=3, episodes=180, final_episodes=53, settings=REACH)  # 36 runs, 2.0 million transitions
SMALL = StudySize(seeds=1, episodes=40, final_episodes=10, horizon=20, settings=REACH[:1])
_RUN = "one/reach-oracle-orbit00-seed0"
_ONE = {
    **{"policy.schemes": ["oracle"], "policy.episodes": 2, "policy.warmup_episodes": 1, "policy.eval_every": 1},
    **{"policy.eval_episodes": 1, "policy.final_episodes": 1},
}


@dataclass(frozen=True)
class _Done:
    """A finished command."""

    seconds: float
    output: str


def run(quick: bool) -> Outcome:
    """Every command in a fresh process, on a run made by training and on a study written by the project's own log."""
    size, rounds = (SMALL, 1) if quick else (FULL, 3)
    with tempfile.TemporaryDirectory() as directory:
        root = Path(directory) / "data"
        settings = [part for key, value in _ONE.items() for part in ("--set", f"{key}={json.dumps(value)}")]
        _pipeline(root, "train-policy", "--name", "one", *settings)
        saved = Path(directory) / "episode.rrd"
        replays = [_pipeline(root, "replay", _RUN, "--episode", "0") for _ in range(rounds)]
        views = [_pipeline(root, "view", f"runs/{_RUN}", "--save", str(saved)) for _ in range(rounds)]
        empty = [_pipeline(root, "list") for _ in range(rounds)]  # a command that does next to nothing
        recording_mb = saved.stat().st_size / 1e6
        study = Path(directory) / "study"
        write_study(study, size)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        analysis = _pipeline(study, "analyze", "--runs", "study", "--set", "analyze.recordings=0")
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    steps = median(json.loads(replay.output)["steps_per_second"] for replay in replays)
    view, replay, start = (median(done.seconds for done in many) for many in (views, replays, empty))
    return Outcome(
        benchmark="afterwards",
        compares=f"an episode viewed and replayed; {size.runs} runs with {size.transitions:,} transitions analysed",
        unit="command",
        targets=[
            Target("view of an episode", view, VIEW_S, "s", at_least=False),
            Target("replay without frames", steps, REPLAY_STEPS_S, "steps/s"),
            Target("recording of an episode", recording_mb, 10.0, "MB", at_least=False),
            Target("analysis of the study", analysis.seconds, ANALYSIS_S, "s", at_least=False),
            Target("its peak memory", max(before, peak) / 1e6, ANALYSIS_GB, "GB", at_least=False),
        ],
        figures={"transitions": size.transitions, "runs": size.runs},
        parts=[
            Part("view of an episode", 1e3 * view, 1e3 * start),
            Part("replay of an episode", 1e3 * replay, 1e3 * start),
            Part("analysis of the study", 1e3 * analysis.seconds, 1e3 * start),
        ],
        notes=[
            "Each a command in a fresh process, starting Python included; the limit is a command that does next to "
            "nothing (`pipeline list`). Peak memory is the largest of all commands of the benchmark.",
            "The analysis is without recordings: the study's episodes are random numbers, with nothing to replay.",
            "pandas, which stable-baselines3 brings and the pipeline does without, is "
            + (
                "installed: pyarrow imports it, which adds 0.3 s to a view."
                if find_spec("pandas")
                else "not installed."
            ),
        ],
    )


def _pipeline(root: Path, *arguments: str) -> _Done:
    command = [sys.executable, "-m", "pipeline", *arguments, "--data", str(root), "--json"]
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return _Done(time.perf_counter() - started, done.stdout)
