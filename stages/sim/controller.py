"""robosuite's JOINT_VELOCITY part controller, without its per-substep overhead.

Same arithmetic in the same order as `robosuite.controllers.parts.generic.joint_vel` (1.5.1), so that torques are equal
bit for bit: PID on joint velocity with anti-windup, gravity compensation, torque limits. What is left out is what the
torque does not depend on: Jacobians, the mass matrix, end-effector references.

It runs 25 times a step, and on seven numbers NumPy is all overhead: compiled by Numba, which robosuite brings along, a
substep's control takes a tenth of the time. Loading Numba takes most of a second, which 200 steps do not save, so an
episode that is to be looked at is faster without. Both give the same bits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

_DERIVATIVE_WINDOW = 5  # robosuite's RingBuffer length


@dataclass(frozen=True)
class VelocityGains:
    """Constants of the controller, read from robosuite's own instance."""

    kp: np.ndarray  # (n,) [Nm s/rad]
    ki: np.ndarray  # (n,)
    kd: np.ndarray  # (n,)
    torque_min: np.ndarray  # (n,) [Nm]
    torque_max: np.ndarray  # (n,) [Nm]
    max_velocity: float  # of action ±1 [rad/s]
    velocity_limits: np.ndarray  # (2,) [rad/s]


class JointVelocityController:
    """One arm's controller; `reset` at the start of an episode."""

    def __init__(
        self, gains: VelocityGains, joints: np.ndarray, actuators: np.ndarray, *, compiled: bool = True
    ) -> None:
        """`joints` and `actuators` (n,) are the arm's indices in the scene's qvel and ctrl."""
        self._gains = gains
        self._constants = np.stack([gains.kp, gains.ki, gains.kd, gains.torque_min, gains.torque_max])  # (5, n)
        self._indices = np.stack([joints, actuators])  # (2, n)
        self._memory = np.zeros((3 + _DERIVATIVE_WINDOW, len(joints)))  # goal, last error, summed error, derivatives
        self._flags = np.zeros(2, np.int64)  # substeps so far, saturated
        self._law = _control
        if compiled:
            self._law = _compiled()
            self._load()

    def _load(self) -> None:
        """Have the compiled code in memory before the first step."""
        still = np.zeros(self._indices.max() + 1)
        self.control(still, still, still.copy())
        self.reset()

    def reset(self) -> None:
        """Forget goal and errors, as robosuite does by making a new controller."""
        self._memory[:] = 0
        self._flags[:] = 0

    def set_goal(self, action: np.ndarray) -> None:
        """Normalised joint velocities (n,) in [−1, 1] → goal velocities [rad/s]."""
        goal = np.clip(action, -1.0, 1.0) * self._gains.max_velocity
        self._memory[0] = np.clip(goal, *self._gains.velocity_limits)

    def control(self, qvel: np.ndarray, bias: np.ndarray, ctrl: np.ndarray) -> None:
        """Set the arm's torques [Nm] in `ctrl` (nu,).

        For the scene's velocities `qvel` (nv,) [rad/s] and gravity-and-Coriolis forces `bias` (nv,) [Nm].
        """
        self._law(qvel, bias, ctrl, self._indices, self._constants, self._memory, self._flags)


def _control(
    qvel: np.ndarray,
    bias: np.ndarray,
    ctrl: np.ndarray,
    indices: np.ndarray,
    constants: np.ndarray,
    memory: np.ndarray,
    flags: np.ndarray,
) -> None:
    """What NumPy runs and Numba compiles."""
    joints, actuators = indices[0], indices[1]
    kp, ki, kd, low, high = constants[0], constants[1], constants[2], constants[3], constants[4]
    error = memory[0] - qvel[joints]
    memory[3 + flags[0] % _DERIVATIVE_WINDOW] = error - memory[1]
    memory[1] = error
    flags[0] += 1
    if not flags[1]:
        memory[2] += error
    filled = min(flags[0], _DERIVATIVE_WINDOW)
    derivative = memory[3].copy()
    for age in range(1, filled):
        derivative += memory[3 + age]
    derivative /= filled
    wanted = kp * error + ki * memory[2] + kd * derivative + bias[joints]
    applied = np.minimum(np.maximum(wanted, low), high)  # a NaN stays one
    flags[1] = np.any(applied != wanted)
    ctrl[actuators] = applied


@cache
def _compiled() -> Callable[..., Any]:
    import numba

    # No fastmath, which would change the order of the arithmetic and so the bits.
    return numba.njit(cache=True)(_control)
