"""A million transitions, watched from outside: memory, file handles, processes, shared memory; and what ends leave."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from statistics import median

import psutil
import pyarrow.parquet as pq

from benchmarks.outcome import Outcome, Target
from schemas.files import transition_parts
from stages.policy.parts import PART_ROWS

_EVERY = 1.0  # [s] between two looks
_SHARED = Path("/dev/shm")
_CACHE = "torchinductor_"  # torch's own, one for all processes of a user, whether it compiles or not
_PATIENCE = 10.0  # [s] for the workers of an ended process to end
_TINY = {
    **{"collect.episodes": 12, "collect.steps": 50, "perception.epochs": 1, "perception.batch_size": 16},
    **{"policy.td3.hidden": [32, 32], "policy.td3.batch_size": 32, "policy.td3.buffer_size": 20_000},
    **{"policy.warmup_episodes": 1},
}
_BLIND = {"policy.schemes": ["oracle"], "policy.seeds": list(range(6)), "policy.episodes": 430}
_SEEING = {"policy.schemes": ["dense"], "policy.seeds": [0, 1], "policy.episodes": 220}
_ENDS: dict[str, tuple[tuple[signal.Signals, ...], int]] = {  # signals, exit code
    "by itself": ((), 0),
    "Ctrl-C": ((signal.SIGINT,), 130),
    "Ctrl-C twice": ((signal.SIGINT, signal.SIGINT), 130),
    "SIGTERM": ((signal.SIGTERM,), 130),
    "SIGKILL": ((signal.SIGKILL,), -9),
}


@dataclass
class _Watched:
    """What a command used while it ran, look by look, and what it left."""

    memory: list[float] = field(default_factory=list)  # [MB], of all its processes
    handles: list[int] = field(default_factory=list)
    seen: set[psutil.Process] = field(default_factory=set)
    shared: set[int] = field(default_factory=set)  # inodes of memory its processes had in common
    seconds: float = 0.0
    left: list[str] = field(default_factory=list)  # processes, shared memory, temporary files
    rows: list[int] = field(default_factory=list)  # of each run's log, in the end

    @property
    def warm(self) -> int:
        """The tenth (of 0 to 9) from which on nothing is new: buffers are full, and each run has had a whole part.

        To write a part takes more memory as it grows.
        """
        share = PART_ROWS / min(self.rows)
        return max(2, ceil(10 * share)) if share <= 0.9 else 2

    def growth(self, values: Sequence[float]) -> float:
        """From when it is warm to the last tenth, as a share."""
        tenth = max(1, len(values) // 10)
        return median(values[-tenth:]) / median(values[self.warm * tenth : (self.warm + 1) * tenth]) - 1


def run(quick: bool) -> Outcome:
    """A million transitions of six oracles, 150,000 with camera and estimator, and every kind of end."""
    with tempfile.TemporaryDirectory() as directory:
        root = Path(directory)
        for command in ("collect", "train-perception"):
            _finished(_start(root, command, {}, "eye"), command)
        blind = {**_BLIND, "policy.final_episodes": 430}
        seeing = {**_SEEING, "policy.final_episodes": 100, "policy.processes": 2, "policy.workers": 1}
        if quick:
            short = {"world.horizon": 20, "policy.episodes": 8, "policy.final_episodes": 8}
            blind, seeing = {**blind, **short}, {**seeing, **short}
        watched = {
            "oracles": _watch(_start(root, "train-policy", blind, "blind"), root),
            "with camera": _watch(_start(root, "train-policy", seeing, "seeing", "--estimator", "eye"), root),
        }
        left = [f"{how}: {found}" for how in _ENDS for found in _ended(root, how, quick)]
        watched["oracles"].rows, watched["with camera"].rows = (_rows(root / "runs" / n) for n in ("blind", "seeing"))
    return _outcome(watched, left, quick)


def _start(root: Path, command: str, settings: Mapping[str, object], name: str, *more: str) -> subprocess.Popen[bytes]:
    """A command in a process group of its own, its temporary files in a directory of their own."""
    (root / "tmp").mkdir(exist_ok=True)
    pairs = [part for key, value in {**_TINY, **settings}.items() for part in ("--set", f"{key}={json.dumps(value)}")]
    dataset = ["--dataset", "eye"] if command == "train-perception" else []
    return subprocess.Popen(
        [sys.executable, "-m", "pipeline", command, "--name", name, "--data", str(root), *dataset, *more, *pairs],
        env=os.environ | {"TMPDIR": str(root / "tmp")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def _finished(process: subprocess.Popen[bytes], what: str) -> None:
    _, said = process.communicate()
    if process.returncode:
        raise RuntimeError(f"{what} failed: {said.decode()}")


def _watch(process: subprocess.Popen[bytes], root: Path, until: float = float("inf")) -> _Watched:
    """Look at a command until it ends, or for so many seconds."""
    found, started = _Watched(), time.monotonic()
    while process.poll() is None and time.monotonic() - started < until:
        _look(found, psutil.Process(process.pid))
        time.sleep(_EVERY)
    found.seconds = time.monotonic() - started
    if until == float("inf"):
        _finished(process, "a soak")
        found.left = _left(found, root)
    return found


def _look(found: _Watched, process: psutil.Process) -> None:
    try:
        family = [process, *process.children(recursive=True)]
        found.seen.update(family)
        found.shared.update(inode for each in family for inode in _shared_memory(each.pid))
        memory, handles = (
            [each.memory_full_info().pss for each in family],
            [each.num_fds() for each in family],
        )
    except (psutil.Error, OSError):  # one has ended between two questions
        return
    found.memory.append(sum(memory) / 1e6)
    found.handles.append(sum(handles))


def _ended(root: Path, how: str, quick: bool) -> list[str]:
    """What is left of a training in several processes that is ended in the middle, or another exit code."""
    signals, code = _ENDS[how]
    short = {"policy.episodes": 4 if quick or not signals else 400, "policy.final_episodes": 1, "world.horizon": 50}
    settings = {**_SEEING, **short, "policy.processes": 2, "policy.workers": 1}
    process = _start(root, "train-policy", settings, how.replace(" ", "-"), "--estimator", "eye")
    found = _watch(process, root, until=20)
    for number in signals:
        os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        time.sleep(1)
    process.communicate()
    return _left(found, root) + ([f"exit code {process.returncode}"] if process.returncode != code else [])


def _left(found: _Watched, root: Path) -> list[str]:
    _, alive = psutil.wait_procs(list(found.seen), timeout=_PATIENCE)
    temporary = sorted(path.name for path in (root / "tmp").iterdir() if not path.name.startswith(_CACHE))
    for name in temporary:
        (root / "tmp" / name).rename(root / f"left-{len(list(root.iterdir()))}-{name}")
    return [
        *(f"process {each.pid}" for each in alive),
        *(f"shared memory {entry.name}" for entry in os.scandir(_SHARED) if entry.inode() in found.shared),
        *(f"temporary {name}" for name in temporary),
    ]


def _shared_memory(pid: int) -> set[int]:
    """Inodes of named memory that a process sees, semaphores too: those were made under other names."""
    lines = [line.split() for line in Path(f"/proc/{pid}/maps").read_text().splitlines()]
    return {int(line[4]) for line in lines if len(line) > 5 and line[5].startswith(f"{_SHARED}/")}


def _rows(group: Path) -> list[int]:
    return [sum(pq.read_metadata(path).num_rows for path in transition_parts(run)) for run in group.iterdir()]


def _outcome(watched: dict[str, _Watched], left: list[str], quick: bool) -> Outcome:
    blind, seeing = watched["oracles"], watched["with camera"]
    left = [*(f"{name}: {found}" for name, each in watched.items() for found in each.left), *left]
    return Outcome(
        benchmark="soak",
        compares="the memory and the file handles of a training at its end with those when it was warm",
        unit="look",
        targets=[
            Target("transitions", sum(blind.rows), 1_900 if quick else 1_000_000),
            Target("growth of memory, oracles", blind.growth(blind.memory), 0.01, at_least=False),
            Target("growth of memory, with camera", seeing.growth(seeing.memory), 0.01, at_least=False),
            Target("growth of file handles, oracles", blind.growth(blind.handles), 0, at_least=False),
            Target("growth of file handles, with camera", seeing.growth(seeing.handles), 0, at_least=False),
            Target("left after an end", len(left), 0, at_least=False),
        ],
        figures={
            **{f"{name}: memory when warm [MB]": median(each.memory) for name, each in watched.items()},
            **{f"{name}: warm from tenth": each.warm + 1 for name, each in watched.items()},
            **{f"{name}: seconds": each.seconds for name, each in watched.items()},
            "with camera: transitions": sum(seeing.rows),
        },
        table=_curve(watched),
        notes=[f"ends: {', '.join(_ENDS)}", *left[:10]],
    )


def _curve(watched: dict[str, _Watched]) -> list[dict[str, object]]:
    """Memory and handles tenth by tenth."""
    rows: list[dict[str, object]] = []
    for name, each in watched.items():
        for tenth in range(10):
            window = slice(tenth * len(each.memory) // 10, (tenth + 1) * len(each.memory) // 10 or 1)
            if each.memory[window]:
                rows.append(
                    {
                        "run": name,
                        "tenth": tenth + 1,
                        "memory [MB]": round(median(each.memory[window]), 1),
                        "file handles": median(each.handles[window]),
                    }
                )
    return rows
