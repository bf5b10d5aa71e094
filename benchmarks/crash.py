"""Kill it anywhere: SIGKILL at random moments of collect, train-perception and train-policy, then --resume.

Required: no published file is ever unreadable, no checkpoint and no finished episode is lost, no process is left over,
and what is resumed ends as what was never interrupted.
"""

import json
import random
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.crash_checks import different, progress, unreadable
from benchmarks.outcome import Outcome, Target

SEED, KILLS, QUICK_KILLS = 20261122, 70, 2  # kills of each stage
_LATEST = 1.5  # of the time that a stage takes: beside another one it takes longer
_PATIENCE = 10.0  # [s] for the workers of a killed process to end
_TINY = {
    **{"world.horizon": 15, "collect.episodes": 24, "collect.steps": 12, "collect.workers": 2},
    **{"perception.epochs": 4, "perception.batch_size": 16},
    **{"policy.schemes": ["oracle", "dense2sparse"], "policy.episodes": 12, "policy.warmup_episodes": 1},
    **{"policy.switch_episode": 5, "policy.eval_every": 4, "policy.eval_episodes": 1, "policy.final_episodes": 4},
    **{"policy.checkpoint_every": 2, "policy.td3.hidden": [32, 32], "policy.td3.batch_size": 32},
}
_CELLS = tuple(f"runs/{{name}}/reach-{scheme}-orbit00-seed0" for scheme in ("oracle", "dense2sparse"))
_SETTINGS = [part for key, value in _TINY.items() for part in ("--set", f"{key}={json.dumps(value)}")]


@dataclass
class _Stage:
    """A command that is killed, and what was found."""

    command: str
    more: tuple[str, ...]
    cells: tuple[str, ...]  # directories of its artifact NAME
    seconds: float = 0.0  # the shortest that it took uninterrupted
    kills: int = 0
    resumed: int = 0  # artifacts that ended after being killed
    broken: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    differing: list[str] = field(default_factory=list)
    orphans: int = 0

    def start(self, root: Path, name: str, resume: bool) -> subprocess.Popen[bytes]:
        """Begin or go on with the artifact."""
        options = ["--name", name, "--data", str(root), *self.more, *(["--resume"] if resume else [])]
        command = [sys.executable, "-m", "pipeline", self.command, *options, *_SETTINGS]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def directories(self, root: Path, name: str) -> list[Path]:
        """Of its artifact."""
        return [root / cell.format(name=name) for cell in self.cells]


def run(quick: bool) -> Outcome:
    """Kill each stage so many times, at moments drawn from `SEED`; two stages at a time, as a start has one thread."""
    kills = QUICK_KILLS if quick else KILLS
    stages = [
        _Stage("collect", (), ("datasets/{name}",)),
        _Stage("train-perception", ("--dataset", "whole"), ("estimators/{name}",)),
        _Stage("train-policy", ("--estimator", "whole"), _CELLS),
    ]
    with tempfile.TemporaryDirectory() as directory, ThreadPoolExecutor(2) as threads:
        root = Path(directory)
        for stage in stages:
            stage.seconds = _whole(stage, root)
        for killed in [threads.submit(_kill_often, stage, root, kills) for stage in stages]:
            killed.result()
    return _outcome(stages, kills)


def _kill_often(stage: _Stage, root: Path, kills: int) -> None:
    rng = random.Random(f"{SEED} {stage.command}")
    while stage.kills < kills:
        _kill_until_done(stage, root, f"killed-{stage.resumed}", kills, rng)


def _whole(stage: _Stage, root: Path) -> float:
    """The artifact without an interruption, and how long it takes [s]."""
    started = time.monotonic()
    process = stage.start(root, "whole", resume=False)
    _, said = process.communicate()
    if process.returncode:
        raise RuntimeError(f"{stage.command} fails uninterrupted: {said.decode()}")
    return time.monotonic() - started


def _kill_until_done(stage: _Stage, root: Path, name: str, kills: int, rng: random.Random) -> None:
    """Kill and resume one artifact until it ends, by itself at the latest when there were kills enough."""
    directories = stage.directories(root, name)
    reached = dict.fromkeys(directories, 0)
    while True:
        resume, started = any(path.exists() for path in directories), time.monotonic()
        process = stage.start(root, name, resume)
        if stage.kills >= kills or not _kill(stage, process, rng.uniform(0.2, _LATEST) * stage.seconds):
            break
        stage.broken += [f"{name}: {problem}" for path in directories if path.exists() for problem in unreadable(path)]
        now = {path: progress(path) for path in directories}
        stage.lost += [f"{p}: from {reached[p]} back to {now[p]}" for p in directories if now[p] < reached[p]]
        reached = now
    _, said = process.communicate()
    if not resume:  # it was quicker than thought: a later moment would be too late for a kill
        stage.seconds = min(stage.seconds, time.monotonic() - started)
    if process.returncode:
        stage.differing.append(f"{name}: exit code {process.returncode}: {said.decode().strip()[-300:]}")
    for whole, other in zip(stage.directories(root, "whole"), directories, strict=True):
        stage.differing += [f"{name}: {file}" for file in different(whole, other)]
    stage.resumed += 1


def _kill(stage: _Stage, process: subprocess.Popen[bytes], after: float) -> bool:
    """SIGKILL after so many seconds; False where it had ended by then."""
    try:
        process.wait(after)
        return False
    except subprocess.TimeoutExpired:
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.communicate()
        stage.kills += 1
        _, left = psutil.wait_procs(workers, timeout=_PATIENCE)
        stage.orphans += len(left)
        return True


def _outcome(stages: list[_Stage], kills: int) -> Outcome:
    def none(name: str, found: list[str]) -> Target:
        return Target(name, len(found), 0, at_least=False)

    broken, lost, differing = ([x for s in stages for x in getattr(s, f)] for f in ("broken", "lost", "differing"))
    return Outcome(
        benchmark="crash",
        compares=f"{', '.join(stage.command for stage in stages)}, {kills} kills each, with themselves uninterrupted",
        unit="kill",
        targets=[
            Target("kills", sum(stage.kills for stage in stages), kills * len(stages)),
            none("published files that cannot be read", broken),
            none("times that finished work was lost", lost),
            none("resumed files that differ from uninterrupted ones", differing),
            Target("processes left over", sum(stage.orphans for stage in stages), 0, at_least=False),
        ],
        figures={f"{stage.command}: artifacts that ended after kills": stage.resumed for stage in stages},
        notes=[f"moments drawn from seed {SEED}", *broken[:5], *lost[:5], *differing[:5]],
    )
