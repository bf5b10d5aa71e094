"""Runs one planned episode in a world and keeps what is to be recorded. No rendering, no files."""

from dataclasses import dataclass

import numpy as np

from schemas.errors import DivergedError
from schemas.mcap_topics import CUBE_FRAME, Placement
from stages.collect.behaviours import Behaviour
from stages.collect.plan import EpisodePlan
from stages.sim.world import World

REACHED = 0.03  # [m] between gripper point and cube centre; SPEC §3
_SCENERY = ("table", "left_eef_target", "right_eef_target")  # bodies that are neither robot nor cube


@dataclass(frozen=True)
class Snapshot:
    """One state, with all that its messages say."""

    step: int
    state: np.void  # of STATE_DTYPE
    integration_state: np.ndarray  # (k,)
    qpos: np.ndarray  # (nq,) of the whole scene
    links: dict[str, Placement]  # robot links and cube in the world


@dataclass(frozen=True)
class Episode:
    """What happened."""

    times_ns: list[int]  # (steps,) of the states the actions were applied from
    actions: np.ndarray  # (steps, action_dim) float32
    initial: Snapshot
    kept: list[Snapshot]
    success: bool  # some state after an action completed the task


class UnstableError(DivergedError):
    """The simulation became unstable, or its input no number, by the last of `actions` (n, action_dim)."""

    def __init__(self, message: str, actions: np.ndarray) -> None:
        super().__init__(message)
        self.actions = actions


def simulate(world: World, plan: EpisodePlan, initial_state: np.ndarray, behaviour: Behaviour, steps: int) -> Episode:
    """Run `steps` control steps.

    Raises:
        UnstableError: the simulation became unstable, or the behaviour's action is no number.
    """
    state = world.reset(initial_state)
    initial, success = take_snapshot(world, 0, state), False
    kept_steps, kept = set(plan.kept_steps), []
    times, actions = [], np.empty((steps, world.action_dim), np.float32)
    for step in range(steps):
        if step in kept_steps:
            kept.append(take_snapshot(world, step, state))
        times.append(int(state["time_ns"]))
        actions[step] = behaviour.act(world, state)
        is_number = bool(np.isfinite(actions[step]).all())
        state = world.step(actions[step]) if is_number else state
        _check_stable(state, is_number, plan, actions[: step + 1])
        success |= is_success(plan.task, state)
    return Episode(times, actions, initial, kept, success)


def take_snapshot(world: World, step: int, state: np.void) -> Snapshot:
    """The world's present state, which is `state`."""
    cube = world.scene.model.body(world.scene.cube_body).name
    poses = {name: pose for name, pose in world.link_poses().items() if name not in _SCENERY}
    links = {CUBE_FRAME if name == cube else name: pose for name, pose in poses.items()}
    return Snapshot(step, state, world.integration_state(), world.qpos_full(), links)


def is_success(task: str, state: np.void) -> bool:
    """Whether the state completes the task (SPEC §3)."""
    if task == "lift":
        return bool(state["lifted"])
    return bool(state["touched"]) or bool(np.linalg.norm(state["eef"] - state["cube_position"]) <= REACHED)


def _check_stable(state: np.void, is_number: bool, plan: EpisodePlan, actions: np.ndarray) -> None:
    if state["unstable"] or not is_number:
        what = "the simulation became unstable" if is_number else "the action is not a number"
        other = "collect.seed or a lower world.max_joint_velocity" if is_number else "policy"
        raise UnstableError(
            f"episode {plan.episode} ({plan.task}, {plan.behaviour}): {what} at step {len(actions) - 1}; "
            f"finished episodes are kept; collect under another name with another {other}",
            actions,
        )
