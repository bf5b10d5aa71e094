"""How the robot acts while data is collected (SPEC §4): at random, by a script, or by an injected policy."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from schemas.errors import unknown_choice
from stages.collect.motion import closing_direction, lean_gripper, move_gripper
from stages.collect.scripts import Goal, Manner, pick_and_place, touch_and_push
from stages.sim.world import World

HOLD_STEPS = (5, 10)
"""A random action is held for 5 to 10 steps (0.25 to 0.5 s): at 20 Hz, one drawn anew every step averages out and the
arm trembles where it is; held, joints wander by about half a radian over an episode."""


class Actor(Protocol):
    """A policy from elsewhere: the true state and the task's name → action (7,) or (8,) in [−1, 1]."""

    def act(self, state: np.void, task: str) -> np.ndarray: ...


ActorFactory = Callable[[], Actor]
"""Makes the actor in each worker process; it must be picklable."""


class Behaviour(Protocol):
    """Acts through one episode."""

    def act(self, world: World, state: np.void) -> np.ndarray: ...


def make_behaviour(
    name: str, noise: float, manner: Manner, rng: np.random.Generator, actor: Actor | None = None
) -> Behaviour:
    """The behaviour called `name`, for one episode; `noise` is the standard deviation on policy-related actions."""
    if name == "random":
        return RandomBehaviour(rng)
    if name == "scripted":
        return NoisyBehaviour(ScriptedBehaviour(manner, rng), noise, rng)
    if name == "policy" and actor is not None:
        return NoisyBehaviour(PolicyBehaviour(actor), noise, rng)
    raise ValueError(unknown_choice("behaviour", name, ("random", "scripted", "policy")))


class RandomBehaviour:
    """Uniform actions, each held for some steps."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._left = 0

    def act(self, world: World, state: np.void) -> np.ndarray:
        """A uniform action (action_dim,), or the one before."""
        del state
        if self._left == 0:
            self._action = self._rng.uniform(-1, 1, world.action_dim).astype(np.float32)
            self._left = int(self._rng.integers(*HOLD_STEPS, endpoint=True))
        self._left -= 1
        return self._action


class ScriptedBehaviour:
    """Follows the task's script from goal to goal, knowing the true state."""

    def __init__(self, manner: Manner, rng: np.random.Generator) -> None:
        self._manner, self._rng = manner, rng
        self._goals: Iterator[Goal] | None = None

    def act(self, world: World, state: np.void) -> np.ndarray:
        """Action (action_dim,) towards the present goal."""
        self._state = state
        if self._goals is None:
            script = pick_and_place if world.task == "lift" else touch_and_push
            self._goals = script(lambda: self._state, self._manner, self._rng)
        goal = next(self._goals)
        if goal.posture is not None:
            arm = lean_gripper(world, state, goal.position, goal.posture)
        else:
            arm = move_gripper(world, state, goal.position, closing_direction(world.gripper_axes(), goal.grasped))
        return np.append(arm, goal.gripper) if world.task == "lift" else arm


class PolicyBehaviour:
    """Does what an injected actor says."""

    def __init__(self, actor: Actor) -> None:
        self._actor = actor

    def act(self, world: World, state: np.void) -> np.ndarray:
        """The actor's action (action_dim,)."""
        return self._actor.act(state, world.task)


class NoisyBehaviour:
    """Another behaviour with Gaussian noise on its actions, as a learning policy explores."""

    def __init__(self, behaviour: Behaviour, noise: float, rng: np.random.Generator) -> None:
        self._behaviour, self._noise, self._rng = behaviour, noise, rng

    def act(self, world: World, state: np.void) -> np.ndarray:
        """Noisy action (action_dim,), clipped to [−1, 1]."""
        action = self._behaviour.act(world, state)
        noisy = action + self._noise * self._rng.standard_normal(len(action))
        return np.clip(noisy, -1, 1).astype(np.float32)
