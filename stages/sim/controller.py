"""robosuite's JOINT_VELOCITY part controller, without its per-substep overhead.

Same arithmetic in the same order as `robosuite.controllers.parts.generic.joint_vel` (1.5.1), so that torques are equal
bit for bit: PID on joint velocity with anti-windup, gravity compensation, torque limits. What is left out is what the
torque does not depend on: Jacobians, the mass matrix, end-effector references.
"""

from dataclasses import dataclass

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

    def __init__(self, gains: VelocityGains) -> None:
        self.gains = gains
        self.reset()

    def reset(self) -> None:
        """Forget goal and errors, as robosuite does by making a new controller."""
        joints = len(self.gains.kp)
        self._goal = np.zeros(joints)
        self._last_error = np.zeros(joints)
        self._summed_error = np.zeros(joints)
        self._derivatives = np.zeros((_DERIVATIVE_WINDOW, joints))
        self._count = 0
        self._saturated = False

    def set_goal(self, action: np.ndarray) -> None:
        """Normalised joint velocities (n,) in [−1, 1] → goal velocities [rad/s]."""
        goal = np.clip(action, -1.0, 1.0) * self.gains.max_velocity
        self._goal = np.clip(goal, *self.gains.velocity_limits)

    def torques(self, qvel: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """Torques (n,) [Nm] for joint velocities [rad/s] and gravity-and-Coriolis forces `bias` (n,) [Nm]."""
        gains = self.gains
        error = self._goal - qvel
        self._derivatives[self._count % _DERIVATIVE_WINDOW] = error - self._last_error
        self._count += 1
        self._last_error = error
        if not self._saturated:
            self._summed_error += error
        filled = min(self._count, _DERIVATIVE_WINDOW)
        derivative = self._derivatives[:filled].sum(axis=0) / filled
        wanted = gains.kp * error + gains.ki * self._summed_error + gains.kd * derivative + bias
        # minimum/maximum rather than np.clip: same values, a third of the time on seven numbers
        applied = np.minimum(np.maximum(wanted, gains.torque_min), gains.torque_max)
        self._saturated = bool((applied != wanted).any())
        return applied
