"""A data root of many finished runs, written by the project's own log: seeded numbers that behave like training.

Joints wander, the gripper comes closer to the cube the longer a run has trained, estimates are off by more where the
camera is turned, and every reward follows from its distance, so that compression and statistics are those of real logs.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

import numpy as np

from pipeline.artifacts.manifests import list_files, write_manifest
from schemas.manifest import Code, Environment, Manifest, config_sha256
from stages.policy import rewards
from stages.policy.config import RunConfig, RunSpec, Scheme
from stages.policy.log import EpisodeHead, RunLog
from stages.policy.observation import observation_dim
from stages.policy.schemes import phase, reward_kind, select_reward
from stages.policy.seeds import RESET_STREAMS, Stream, entropy, generator
from stages.policy.summaries import episode_row, evaluation_row
from stages.sim.config import WorldConfig

SETTINGS = (("reach", 0.0), ("reach", 5.0), ("reach", 10.0), ("lift", 0.0))  # the paper's: task, misalignment [degrees]
SCHEMES = get_args(Scheme)
STEP_NS = 50_000_000
_STATE = 60  # numbers in a packed state, about
_SEED = np.random.SeedSequence(20)


@dataclass(frozen=True)
class StudySize:
    """How much is written; every run has the paper's order of training, evaluation and checkpoints."""

    seeds: int
    episodes: int
    final_episodes: int
    horizon: int = 200
    settings: tuple[tuple[str, float], ...] = SETTINGS

    @property
    def config(self) -> RunConfig:
        """Of every run."""
        return RunConfig(
            episodes=self.episodes, switch_episode=max(1, self.episodes // 3), final_episodes=self.final_episodes
        )

    @property
    def runs(self) -> int:
        """Cells of the matrix."""
        return len(self.settings) * len(SCHEMES) * self.seeds

    @property
    def transitions(self) -> int:
        """Rows of the view `transitions`."""
        config = self.config
        evaluated = config.episodes // config.eval_every * config.eval_episodes
        return self.runs * self.horizon * (config.episodes + evaluated + config.final_episodes)


FULL = StudySize(seeds=4, episodes=400, final_episodes=285)  # 64 runs, 10.05 million transitions
SMALL = StudySize(seeds=1, episodes=40, final_episodes=10, horizon=20)


def write_study(root: Path, size: StudySize, processes: int = 2) -> None:
    """Write all runs below `root`/runs/study."""
    cells = list(product(size.settings, SCHEMES, range(size.seeds)))
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for _ in pool.map(partial(_write_run, root, size), cells):
            pass


def _write_run(root: Path, size: StudySize, cell: tuple[tuple[str, float], str, int]) -> None:
    (task, degrees), scheme, seed = cell
    name = f"{task}-{scheme}-orbit{degrees:02.0f}-seed{seed}"
    out = root / "runs" / "study" / name
    out.mkdir(parents=True)
    world = WorldConfig(horizon=size.horizon)
    spec = RunSpec(f"study/{name}", task, scheme, "orbit", degrees, seed, world, size.config, out)  # type: ignore[arg-type]
    _Run(spec).write()
    _publish(spec)


class _Run:
    """One run's log, filled episode by episode as the training loop does."""

    def __init__(self, spec: RunSpec) -> None:
        self.spec, self.actions = spec, 8 if spec.task == "lift" else 7
        self.log = RunLog(spec, observation_dim(spec.config.proprioception), self.actions)

    def write(self) -> None:
        """Training with its evaluations, then the final evaluation."""
        config = self.spec.config
        for done in range(1, config.episodes + 1):
            self._episode("train", done - 1, done - 1)
            self._updates(done - 1)
            if done % config.eval_every == 0:
                first = (done // config.eval_every - 1) * config.eval_episodes
                self._evaluate("eval", first, config.eval_episodes, done)
        self._evaluate("final", 0, config.final_episodes, config.episodes)
        self.log.flush()

    def _evaluate(self, split: str, first: int, count: int, done: int) -> None:
        rows = [self._episode(split, episode, done - 1) for episode in range(first, first + count)]
        step = done * self.spec.world.horizon
        self.log.add("evaluations", evaluation_row(split, len(self.log.rows("evaluations")), done, step, rows))

    def _episode(self, split: str, episode: int, trained: int) -> dict[str, object]:
        spec, config = self.spec, self.spec.config
        stream = RESET_STREAMS[split]
        rng = np.random.default_rng([spec.seed, stream, episode, int(spec.misalignment_deg), *map(ord, spec.scheme)])
        columns = episode_columns(rng, spec, trained, self.actions)
        head = EpisodeHead(split, episode, trained * spec.world.horizon, phase(spec.scheme, trained, config))
        self.log.add_transitions(head, columns)
        state, seeds = rng.standard_normal(_STATE), entropy(spec.seed, stream, episode)
        row = episode_row(head, columns, seeds, state, state + 0.1, seconds=1.5)
        self.log.add("episodes", row)
        return row

    def _updates(self, episode: int) -> None:
        rng, horizon = generator(self.spec.seed, Stream.BATCH, episode), self.spec.world.horizon
        names = ("critic1_loss", "critic2_loss", "actor_loss", "q1_mean", "q2_mean", "target_q_mean")
        for update in range(horizon * episode, horizon * (episode + 1), self.spec.config.log_updates_every):
            losses = dict(zip(names, rng.gamma(2.0, 0.1, len(names)).tolist(), strict=True))
            head = {"update": update, "global_step": update, "episode": episode, "phase": "dense"}
            self.log.add("updates", head | losses)


def episode_columns(rng: np.random.Generator, spec: RunSpec, trained: int, actions: int) -> dict[str, np.ndarray]:
    """The transition columns (T, …) of one episode after `trained` training episodes."""
    steps, progress = spec.world.horizon, 1 - np.exp(-trained / (0.25 * spec.config.episodes))
    action = np.clip(rng.normal(0, 0.6, (steps, actions)), -1, 1).astype(np.float32)
    velocity = np.concatenate([np.zeros((1, 7)), 0.5 * action[:, :7] + rng.normal(0, 1e-3, (steps, 7))])
    joints = rng.normal(0, 0.02, 7) + np.cumsum(0.05 * velocity, axis=0)  # (T + 1, 7), as all states
    cube = np.append(rng.uniform(-0.15, 0.15, 2), 0.825) + np.zeros((steps + 1, 3))
    distance = _distances(rng, progress, _skill(spec), steps + 1)
    away = rng.normal(size=3) + np.cumsum(rng.normal(0, 0.02, (steps + 1, 3)), axis=0)
    eef = cube + distance[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)
    estimate = cube + 0.002 * spec.misalignment_deg + rng.normal(0, 0.008, cube.shape)
    seen = cube if spec.scheme == "oracle" else estimate
    opening = np.full((steps + 1, 1), 0.001) if spec.task == "reach" else rng.uniform(0, 0.08, (steps + 1, 1))
    states = np.concatenate([seen, joints, velocity, opening, eef, seen - eef], axis=1).astype(np.float32)
    after = {"eef": eef[1:], "cube_true": cube[1:], "cube_est": estimate[1:]}
    return {
        "observation": states[:-1],
        "next_observation": states[1:],
        "action": action,
        "time_ns": STEP_NS * np.arange(1, steps + 1),
        **{name: values.astype(np.float32) for name, values in after.items()},
        **_scores(spec, trained, **after),
    }


def _skill(spec: RunSpec) -> float:
    """Share of episodes that succeed after training."""
    lost = {"dense": 0.02, "sparse": 0.06}.get(spec.scheme, 0.002) * spec.misalignment_deg
    return {"dense": 0.95, "sparse": 0.9}.get(spec.scheme, 0.99) - lost


def _distances(rng: np.random.Generator, progress: float, skill: float, states: int) -> np.ndarray:
    """Distance to the cube (T + 1,) [m]: falls to the cube or to somewhere near it, the faster the more was learnt."""
    start = rng.uniform(0.2, 0.45)
    end = 0.015 if rng.random() < skill * progress else rng.uniform(0.05, 0.3)
    falling = np.exp(-(0.005 + 0.06 * progress) * np.arange(states))
    return end + (start - end) * falling + np.abs(rng.normal(0, 0.002, states))


def _scores(
    spec: RunSpec, trained: int, eef: np.ndarray, cube_true: np.ndarray, cube_est: np.ndarray
) -> dict[str, np.ndarray]:
    """What the log says of states with these positions (T, 3): stages.policy.scoring, and the contacts."""
    true, estimated = (np.linalg.norm(eef - cube, axis=1) for cube in (cube_true, cube_est))
    touched = true <= 0.033
    grasped = touched & (spec.task == "lift")
    lifted = grasped & (np.arange(len(true)) > 0.4 * len(true))
    dense_true, dense_est = (rewards.dense(spec.task, d, grasped, lifted) for d in (true, estimated))
    sparse = rewards.sparse(spec.task, true, touched, grasped, lifted)
    kind = reward_kind(spec.scheme, trained, spec.config)
    floats = {
        "distance_true": true,
        "distance_est": estimated,
        "estimation_error": np.linalg.norm(cube_est - cube_true, axis=1),
        "reward_dense_true": dense_true,
        "reward_dense_est": dense_est,
        "reward_sparse": sparse,
        "reward_used": select_reward(spec.scheme, kind, dense_true, dense_est, sparse),
    }
    success = rewards.succeeded(spec.task, true, touched, lifted)
    contacts = {"touched": touched, "grasped": grasped, "lifted": lifted, "success": success}
    return {name: column.astype(np.float32) for name, column in floats.items()} | contacts


def _publish(spec: RunSpec) -> None:
    """The manifest of a complete run."""
    identity = {
        name: getattr(spec, name) for name in ("task", "scheme", "misalignment_kind", "misalignment_deg", "seed")
    }
    config = {
        "world": spec.world.model_dump(mode="json"),
        "policy": spec.config.model_dump(mode="json"),
        "run": identity,
        "estimator": None,
    }
    manifest = Manifest(
        id=f"runs/{spec.run_id}",
        stage="train-policy",
        name="study",
        status="complete",
        created_at="2026-01-02T03:04:05+00:00",
        config=config,
        config_sha256=config_sha256(config),
        inputs=[],
        code=Code(version="0", git_commit=None, dirty=None),
        environment=Environment(python="", platform="", cpu="", gpu=None, gl_renderer=None, packages={}),
        files=list_files(spec.out),
        summary={"episodes": spec.config.episodes},
    )
    write_manifest(manifest, spec.out)
