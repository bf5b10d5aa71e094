"""robosuite's own environment with the methods of `stages.sim.world.World`: what our stepping is compared with."""

from typing import Any

import mujoco
import numpy as np

from stages.sim.config import WorldConfig
from stages.sim.robosuite_scene import make_environment
from stages.sim.state import pack_state, unpack_state
from stages.sim.world import World


class StockWorld:
    """Stock robosuite, soft resets, on the scene of `config`; `options` go to robosuite."""

    def __init__(self, config: WorldConfig, task: str, **options: Any) -> None:
        self.environment, self.task = make_environment(config, **options), task
        self.environment.reset()
        self.model, self.data = self.environment.sim.model._model, self.environment.sim.data._data

    def reset(self, initial_state: np.ndarray) -> None:
        """Start an episode from an integration state, as `World.reset` does."""
        self.environment.reset()
        unpack_state(self.model, self.data, initial_state)
        mujoco.mj_forward(self.model, self.data)

    def step(self, action: np.ndarray) -> dict[str, Any]:
        """Apply the action (7,) of reach, where the gripper stays closed, or (8,) of lift; robosuite's observation."""
        action = np.asarray(action, dtype=np.float64)
        return self.environment.step(np.append(action, 1.0) if self.task == "reach" else action)[0]

    def integration_state(self) -> np.ndarray:
        """Everything the future depends on: (k,) float64."""
        return pack_state(self.model, self.data)


def largest_difference(world: World, stock: StockWorld, start: np.ndarray, actions: np.ndarray) -> float:
    """Between the integration states of both, after each of the actions (n, action_dim) from one state."""
    world.reset(start)
    stock.reset(start)
    largest = 0.0
    for action in actions:
        world.step(action)
        stock.step(action)
        largest = max(largest, float(np.abs(world.integration_state() - stock.integration_state()).max()))
    return largest
