"""robosuite's JOINT_VELOCITY part controller, without its per-substep overhead.

Same arithmetic in the same order as `robosuite.controllers.parts.generic.joint_vel` (1.5.1), so that torques are equal
bit for bit: PID on joint velocity with anti-windup, gravity compensation, torque limits. What is left out is what the
torque does not depend on: Jacobians, the mass matrix, end-effector references.

It runs 25 times a step, and on seven numbers NumPy is all overhead: compiled by Numba, which robosuite brings along, a
substep's control takes a tenth of the time.
"""

from dataclasses import dataclass

import numba
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

    def __init__(self, gains: VelocityGains, joints: np.ndarray, actuators: np.ndarray) -> None:
        """`joints` and `actuators` (n,) are the arm's indices in the scene's qvel and ctrl."""
        self._gains = gains
        self._constants = np.stack([gains.kp, gains.ki, gains.kd, gains.torque_min, gains.torque_max])  # (5, n)
        self._indices = np.stack([joints, actuators])  # (2, n)
        self._memory = np.zeros((3 + _DERIVATIVE_WINDOW, len(joints)))  # goal, last error, summed error, derivatives
        self._flags = np.zeros(2, np.int64)  # substeps so far, saturated
        self._load()

    def _load(self) -> None:
        """Have the compiled code in memory before the first step: loading it takes as long as 300 steps."""
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
        _control(qvel, bias, ctrl, self._indices, self._constants, self._memory, self._flags)


@numba.njit(cache=True)  # no fastmath, which would change the order of the arithmetic and so the bits
def _control(
    qvel: np.ndarray,
    bias: np.ndarray,
    ctrl: np.ndarray,
    indices: np.ndarray,
    constants: np.ndarray,
    memory: np.ndarray,
    flags: np.ndarray,
) -> None:
    newest, saturated = flags[0] % _DERIVATIVE_WINDOW, False
    flags[0] += 1
    filled = min(flags[0], _DERIVATIVE_WINDOW)
    for j in range(indices.shape[1]):
        joint, derivatives = indices[0, j], memory[3:, j]
        error = memory[0, j] - qvel[joint]
        derivatives[newest] = error - memory[1, j]
        memory[1, j] = error
        if not flags[1]:
            memory[2, j] += error
        derivative = derivatives[0]
        for age in range(1, filled):
            derivative += derivatives[age]
        derivative /= filled
        kp, ki, kd, low, high = constants[:, j]
        wanted = kp * error + ki * memory[2, j] + kd * derivative + bias[joint]
        applied = low if wanted < low else high if wanted > high else wanted  # a NaN stays one
        saturated |= applied != wanted
        ctrl[indices[1, j]] = applied
    flags[1] = saturated
