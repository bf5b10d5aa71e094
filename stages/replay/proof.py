"""Whether a re-simulated episode is the logged one, quantity by quantity."""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from schemas.errors import ArtifactError
from schemas.manifest import Manifest
from stages.policy import rewards
from stages.replay.logs import LoggedEpisode, load_episode
from stages.replay.simulate import Trajectory, simulate

_PHYSICS = ("mujoco", "robosuite", "numpy", "numba")  # packages whose version can change a trajectory
_ROUNDING = 1e-6  # of what is computed from the state, in whatever order of operations
_SIGNALS = ("touched", "grasped", "lifted")


@dataclass(frozen=True)
class Difference:
    """Logged against re-simulated, of one quantity."""

    max_abs: float  # of the quantity's own unit; infinite where a value is not a number
    first_step: int | None  # first row that differs; None: none does


@dataclass(frozen=True)
class ReplayResult:
    """Outcome of a replay."""

    run: str
    split: str
    episode: int
    steps: int
    differences: dict[str, Difference]
    version_changes: list[str]  # packages that changed since the run, "name logged → present"
    code: str  # of this pipeline, that made the run
    steps_per_second: float

    @property
    def identical(self) -> bool:
        """Every logged quantity of the state is equal bit for bit, and what is computed from it to the last digit."""
        return self.first_step is None

    @property
    def first_step(self) -> int | None:
        """First step at which a quantity differs."""
        steps = [d.first_step for d in self.differences.values() if d.first_step is not None]
        return min(steps, default=None)

    @property
    def max_abs_difference(self) -> float:
        """Largest difference of any quantity."""
        return max(difference.max_abs for difference in self.differences.values())

    def require_identical(self) -> None:
        """Pass if the replay is the logged episode.

        Raises:
            ArtifactError: it is not; names the first step and quantity that differ, and what may be the cause.
        """
        if not self.identical:
            error = ArtifactError(self.message())
            error.details = self.as_dict()
            raise error

    def message(self) -> str:
        """One sentence for a person."""
        where = f"{self.run} {self.split} episode {self.episode}"
        if self.identical:
            return f"{where}: {self.steps} steps replayed, identical (maximum difference {self.max_abs_difference:.1g})"
        first = min(self.differences.items(), key=lambda item: _order(item[1]))
        return (
            f"{where} does not replay: {first[0]} differs, first at step {self.first_step} "
            f"(at most by {first[1].max_abs:.3g}); {self._cause()}"
        )

    def _cause(self) -> str:
        if self.version_changes:
            return (
                f"the run was made with other versions ({', '.join(self.version_changes)}): install those to replay it"
            )
        return (
            f"package versions are those of the run, so the logs were changed, or made by other code ({self.code}) or "
            "on a different kind of machine"
        )

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "run": self.run,
            "split": self.split,
            "episode": self.episode,
            "steps": self.steps,
            "identical": self.identical,
            "max_abs_difference": self.max_abs_difference,
            "first_different_step": self.first_step,
            "differences": {name: d.max_abs for name, d in self.differences.items()},
            "version_changes": self.version_changes,
            "steps_per_second": round(self.steps_per_second, 1),
        }


def replay(run_dir: Path, split: str, episode: int | None) -> ReplayResult:
    """Re-simulate a logged episode and compare every logged quantity of the world with it.

    Raises:
        ArtifactError: no such run or episode, damaged logs, or a state of another scene. A difference is no error
            here: ask `ReplayResult.require_identical`.
    """
    logged = load_episode(run_dir, split, episode)
    return compare(logged, simulate(logged))


def compare(logged: LoggedEpisode, trajectory: Trajectory) -> ReplayResult:
    """Differences between the logs and a re-simulation of them."""
    return ReplayResult(
        run=logged.run,
        split=logged.split,
        episode=logged.episode,
        steps=logged.steps,
        differences=_differences(logged, trajectory),
        version_changes=version_changes(logged.manifest),
        code=_code(logged.manifest),
        steps_per_second=logged.steps / max(trajectory.seconds, 1e-9),
    )


def version_changes(manifest: Manifest) -> list[str]:
    """Packages that decide a trajectory and are not what the manifest names."""
    recorded = manifest.environment.packages
    present = {name: _installed(name) for name in _PHYSICS if name in recorded}
    return [f"{name} {recorded[name]} → {now}" for name, now in present.items() if now != recorded[name]]


def _code(manifest: Manifest) -> str:
    code = manifest.code
    commit = f", commit {code.git_commit[:7]}" if code.git_commit else ""
    return f"version {code.version}{commit}{', changed' * bool(code.dirty)}"


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _differences(logged: LoggedEpisode, trajectory: Trajectory) -> dict[str, Difference]:
    states, rows = trajectory.states, logged.rows
    exact = {
        "time_ns": (rows["time_ns"], states["time_ns"]),
        "eef": (logged.vector("eef"), states["eef"]),
        "cube_true": (logged.vector("cube_true"), states["cube_position"]),
        **{name: (rows[name], states[name]) for name in _SIGNALS},
    }
    found = {name: _difference(past, present.astype(past.dtype)) for name, (past, present) in exact.items()}
    for name, values in _judged(logged.task, states).items():
        found[name] = _difference(rows[name], values.astype(rows[name].dtype), tolerance=_ROUNDING)
    return found | {"final_state": _final_difference(logged, trajectory)}


def _judged(task: str, states: np.ndarray) -> dict[str, np.ndarray]:
    """What the logs derive from the true state."""
    distance = np.linalg.norm(states["eef"] - states["cube_position"], axis=-1)
    touched, grasped, lifted = (states[name] for name in _SIGNALS)
    return {
        "distance_true": distance,
        "reward_dense_true": rewards.dense(task, distance, grasped, lifted),
        "reward_sparse": rewards.sparse(task, distance, touched, grasped, lifted),
        "success": rewards.succeeded(task, distance, touched, lifted),
    }


def _difference(logged: np.ndarray, simulated: np.ndarray, tolerance: float = 0.0) -> Difference:
    """Of rows (n,) or (n, d)."""
    past, now = (values.astype(np.float64).reshape(len(logged), -1) for values in (logged, simulated))
    gap = np.where((past == now) | (np.isnan(past) & np.isnan(now)), 0.0, np.abs(past - now))
    gap = np.where(np.isnan(gap), np.inf, gap).max(axis=1)  # (n,): one that is no number alone is as far off as can be
    steps = np.flatnonzero(gap > tolerance)
    return Difference(float(gap.max(initial=0.0)), int(steps[0]) if len(steps) else None)


def _final_difference(logged: LoggedEpisode, trajectory: Trajectory) -> Difference:
    """Of the float64 state after the last step: what float32 columns round away shows here."""
    if logged.final_state.shape != trajectory.final_state.shape:
        return Difference(np.inf, logged.steps - 1)
    gap = _difference(logged.final_state[None], trajectory.final_state[None])
    return Difference(gap.max_abs, None if gap.first_step is None else logged.steps - 1)


def _order(difference: Difference) -> tuple[float, float]:
    first = np.inf if difference.first_step is None else difference.first_step
    return first, -difference.max_abs
