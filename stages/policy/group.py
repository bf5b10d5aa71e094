"""Runs that step in lockstep in one process: resume them, train, evaluate, keep the policy."""

from pathlib import Path
from typing import Any

import numpy as np

from schemas.progress import Progress, Task
from stages.memory import keep_freed_memory
from stages.perception.estimator import Estimator
from stages.policy import checkpoint, offline
from stages.policy.checkpoint import Position
from stages.policy.config import RunResult, RunSpec
from stages.policy.log import RunLog
from stages.policy.loop import Lockstep
from stages.policy.observation import observation_dim, sizes
from stages.policy.recorder import Recorder
from stages.policy.replay_buffer import ReplayBuffer
from stages.policy.resources import Share
from stages.policy.td3 import TD3
from stages.sim.camera import intrinsics, misaligned, nominal_pose
from stages.sim.config import CameraConfig
from stages.sim.pool import View, WorldPool
from stages.sim.scene import build_scene

START = Position(0, 0)


def train_group(group: list[RunSpec], estimator: Path | None, share: Share, progress: Progress) -> list[RunResult]:
    """Train runs of one task, world, configuration and resume point in lockstep, in this process."""
    keep_freed_memory()
    loaded = Estimator.load(estimator, device=share.device) if estimator else None
    first = group[0]
    view = _view(group, loaded)
    worlds = WorldPool(first.world, first.task, len(group), view, share.workers)
    try:
        dims = observation_dim(first.config.proprioception), worlds.action_dim
        td3 = TD3(first.config.td3, *dims, [spec.seed for spec in group], share.device)
        room = max(offline.count(spec.sources) for spec in group) or first.config.episodes * first.world.horizon
        capacity = min(first.config.td3.buffer_size, room)
        buffer = ReplayBuffer(len(group), capacity, *dims)
        logs = [RunLog(spec, *dims) for spec in group]
        position = _resume(group, td3, buffer, logs)
        recorder = _recorder(group, loaded, view)
        lockstep = Lockstep(group, worlds, loaded, td3, buffer, logs, share.threads, share.overlap, recorder)
        Schedule(lockstep, td3, group, logs).run(position, progress)
    finally:
        worlds.close()
    return [_result(lockstep, td3, row) for row in range(len(group))]


def _view(group: list[RunSpec], estimator: Estimator | None) -> View | None:
    """Each run's camera: the estimator's nominal one, misaligned as the run says."""
    if estimator is None:
        return None
    camera = CameraConfig.model_validate(estimator.camera)
    nominal, pivot = nominal_pose(camera), np.array(camera.target)
    poses = [misaligned(nominal, spec.misalignment_kind, spec.misalignment_deg, pivot) for spec in group]
    return View(tuple(poses), camera.image_size, camera.fovy)


def _recorder(group: list[RunSpec], estimator: Estimator | None, view: View | None) -> Recorder | None:
    """Who records frames, where there are some and they are asked for."""
    first = group[0]
    if estimator is None or view is None or not first.config.record_every:
        return None
    camera = intrinsics(CameraConfig.model_validate(estimator.camera))
    return Recorder(group, view, camera.matrix, build_scene(first.world).joint_names)


def _resume(group: list[RunSpec], td3: TD3, buffer: ReplayBuffer, logs: list[RunLog]) -> Position:
    """Put every run back to the newest checkpoint all have; the log is the source of the replay buffer."""
    common = set.intersection(*(set(checkpoint.available(spec.out)) for spec in group))
    position = max(common, default=START)
    for spec in group:  # before a log is cut: what counts on more of it than it will hold is of no use to anybody
        checkpoint.drop_after(spec.out, position)
    for row, (spec, log) in enumerate(zip(group, logs, strict=True)):
        if spec.sources:
            offline.fill(buffer, row, spec.sources)
        _standardise(td3, buffer, row, spec)
        if position == START:
            log.restore({"episodes": 0, "evaluations": 0, "updates": 0})
            continue
        log.restore(checkpoint.load(spec.out, spec.run_id, position, td3, row).counts)
        if not spec.sources:
            _refill(buffer, row, spec, log, position.episodes)
    return position


def _standardise(td3: TD3, buffer: ReplayBuffer, row: int, spec: RunSpec) -> None:
    """What the run's networks see: observations by typical sizes, or, in TD3+BC, by those that its logs have."""
    if spec.sources and spec.config.td3.behaviour_cloning is not None:
        td3.standardise(row, *buffer.moments(row))
    else:
        deviation = sizes(spec.config.observation_scale, spec.config.proprioception)
        td3.standardise(row, np.zeros_like(deviation), deviation)


def _refill(buffer: ReplayBuffer, row: int, spec: RunSpec, log: RunLog, episodes: int) -> None:
    """The buffer as it was after `episodes` training episodes, the switch at its place."""
    data = log.training_transitions()
    switch = spec.config.switch_episode if spec.scheme == "dense2sparse" else episodes
    fields = ("observation", "action", "reward_used", "reward_sparse", "next_observation", "terminated")
    before = data["episode"] < switch
    buffer.add(row, *(data[name][before] for name in fields))
    if switch < episodes:
        buffer.switch(row, spec.config.buffer)
        buffer.add(row, *(data[name][~before] for name in fields))


class Schedule:
    """The order of training episodes, evaluations and checkpoints (SPEC §5)."""

    def __init__(self, lockstep: Lockstep, td3: TD3, group: list[RunSpec], logs: list[RunLog]) -> None:
        self._lockstep, self._td3, self._group, self._logs = lockstep, td3, group, logs
        self._config = group[0].config

    def run(self, position: Position, progress: Progress) -> None:
        """From `position` to the end."""
        config = self._config
        total = config.episodes + config.episodes // config.eval_every * config.eval_episodes + config.final_episodes
        evaluated = position.episodes // config.eval_every * config.eval_episodes
        done = position.episodes + evaluated + position.final
        with progress.task(f"{self._group[0].task}, {len(self._group)} runs", total, done) as task:
            for episode in range(position.episodes, config.episodes):
                if self._lockstep.alive:
                    self._train(episode, task, progress)
            for final in range(position.final, config.final_episodes):
                if self._lockstep.alive:
                    self._final(final, task, progress)

    def _train(self, episode: int, task: Task, progress: Progress) -> None:
        config, done = self._config, episode + 1
        if self._group[0].sources:
            self._lockstep.learn_episode(episode, task)
        else:
            self._lockstep.train_episode(episode, task)
        if done % config.eval_every == 0:
            first = (done // config.eval_every - 1) * config.eval_episodes
            self._lockstep.evaluate("eval", first, config.eval_episodes, done, task)
            self._lockstep.summarise_evaluation("eval", first, config.eval_episodes, done)
        is_due = done % config.checkpoint_every == 0 or done == config.episodes
        self._checkpoint(Position(done, 0), is_due, progress)

    def _final(self, episode: int, task: Task, progress: Progress) -> None:
        config, done = self._config, episode + 1
        self._lockstep.evaluate("final", episode, 1, config.episodes, task)
        if done == config.final_episodes:
            self._lockstep.summarise_evaluation("final", 0, config.final_episodes, config.episodes)
        is_due = done % config.checkpoint_every == 0 or done == config.final_episodes
        self._checkpoint(Position(config.episodes, done), is_due, progress)

    def _checkpoint(self, position: Position, is_due: bool, progress: Progress) -> None:
        """Keep everything up to `position` where that is due, or where it is time to stop."""
        stopping = progress.stopping()
        if is_due or stopping:
            self._save(position)
        if stopping:
            raise KeyboardInterrupt

    def _save(self, position: Position) -> None:
        for row in self._lockstep.alive:
            self._logs[row].flush()
            spec = self._group[row]
            checkpoint.save(spec.out, spec.run_id, position, self._td3, row, self._logs[row].counts())


def _result(lockstep: Lockstep, td3: TD3, row: int) -> RunResult:
    spec, log, error = lockstep.specs[row], lockstep.logs[row], lockstep.errors[row]
    summary = _summary(lockstep, spec, log)
    log.flush()
    if error is not None:
        return RunResult(spec.run_id, "failed", summary, error)
    description = {
        "task": spec.task,
        "proprioception": spec.config.proprioception,
        "hidden": list(spec.config.td3.hidden),
        "observation_dim": td3.actor_net.sizes[0],
        "action_dim": td3.actor_net.sizes[-1],
        "summary": summary,
    }
    checkpoint.publish(spec.out, td3, row, description)
    return RunResult(spec.run_id, "complete", summary)


def _summary(lockstep: Lockstep, spec: RunSpec, log: RunLog) -> dict[str, Any]:
    """Headline figures of a run for its manifest; of one that learns from logs an episode is its updates."""
    evaluations, episodes = log.rows("evaluations"), log.rows("episodes")
    final = next((row for row in reversed(evaluations) if row["split"] == "final"), None)
    last = final or (evaluations[-1] if evaluations else None)
    trained = sum(row["split"] == "train" for row in episodes)
    if spec.sources:
        trained = max((row["after_episode"] for row in evaluations), default=0)
    errors = [row["mean_estimation_error"] for row in episodes if row["mean_estimation_error"] is not None]
    return {
        "episodes": trained,
        "global_steps": trained * lockstep.horizon,
        "final_return": last and last["mean_return"],
        "final_success_rate": last and last["success_rate"],
        "best_eval_return": max((r["mean_return"] for r in evaluations if r["split"] == "eval"), default=None),
        "estimation_error": float(np.mean(errors)) if errors else None,
        "steps_per_second": lockstep.steps / lockstep.seconds if lockstep.seconds else None,
        "wall_time_s": float(sum(row["wall_time_s"] for row in episodes)) + lockstep.learning_seconds,
    }
