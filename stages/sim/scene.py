"""The compiled scene: robosuite's `Lift` with a 5 cm cube, and what the world needs to know about it."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from stages.sim import scene_cache
from stages.sim.config import WorldConfig
from stages.sim.controller import VelocityGains

CUBE_HALF_SIZE = 0.025  # [m]; paper §V-B: 5 × 5 × 5 cm
TABLE_HEIGHT = 0.8  # [m]; robosuite's Lift
CONTROL_FREQUENCY = 20  # [Hz]; SPEC §3


@dataclass(frozen=True, eq=False)
class Facts:
    """What robosuite knows about a compiled model."""

    xml: str
    gripper_ramp: np.ndarray  # (a,) added to the gripper's goal in a control step that closes it
    gains: VelocityGains
    arm_qpos: np.ndarray  # (7,) indices
    arm_qvel: np.ndarray  # (7,)
    arm_actuators: np.ndarray  # (7,)
    gripper_qpos: np.ndarray  # (g,)
    gripper_actuators: np.ndarray  # (a,)
    joint_names: tuple[str, ...]  # of the arm
    rest_qpos: np.ndarray  # (7,) [rad] robosuite's initial pose of the arm
    gripper_rest_qpos: np.ndarray  # (g,) robosuite's initial pose of the gripper
    cube_qpos: int  # first of the seven of its free joint
    cube_body: int
    grip_site: int
    finger_geoms: dict[str, np.ndarray]  # geom ids: cube, left_pad, right_pad, fingers, hand


@dataclass(frozen=True, eq=False)
class Scene(Facts):
    """Compiled model and indices. Shared by every world and renderer of a process; never modified."""

    config: WorldConfig
    model: Any  # mujoco.MjModel

    @property
    def substeps(self) -> int:
        """Physics steps per control step."""
        return int(1 / CONTROL_FREQUENCY / self.model.opt.timestep)


@lru_cache(maxsize=2)
def build_scene(config: WorldConfig) -> Scene:
    """The scene, compiled (seconds) or as it was kept on disk; shared for the life of the process."""

    def make() -> tuple[Any, dict[str, Any]]:
        from stages.sim.robosuite_scene import compile_scene  # imports robosuite: half a second

        model, facts = compile_scene(config)
        return model, _to_plain(facts)

    model, plain = scene_cache.kept("scene", config, make)
    return Scene(**_from_plain(plain), config=config, model=model)


def _to_plain(facts: Facts) -> dict[str, Any]:
    """As JSON has it: floats keep every bit there."""
    values = vars(facts) | {"gains": vars(facts.gains)}
    return {name: _listed(value) for name, value in values.items()}


def _listed(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _listed(item) for name, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _from_plain(plain: dict[str, Any]) -> dict[str, Any]:
    """The inverse of `_to_plain`, as keywords."""
    return _arrays(plain) | {
        "gains": VelocityGains(**_arrays(plain["gains"])),
        "finger_geoms": {group: np.array(ids, dtype=int) for group, ids in plain["finger_geoms"].items()},
        "joint_names": tuple(plain["joint_names"]),
    }


def _arrays(plain: dict[str, Any]) -> dict[str, Any]:
    return {name: np.array(value) if isinstance(value, list) else value for name, value in plain.items()}
