"""Resolved-rate control of the gripper: where it should go → normalised joint velocities."""

import numpy as np

from stages.sim.rotation import matrix_of
from stages.sim.world import World

POSITION_GAIN = 4.0  # [1/s]
ROTATION_GAIN = 2.0  # [1/s]
REST_GAIN = 0.5  # [1/s], of the redundant joint towards the rest pose
POSTURE_GAIN = 2.0  # [1/s], of the joints that a position alone leaves free towards a posture
MAX_SPEED = 0.5  # of the gripper [m/s]
DAMPING = 0.02  # of the least squares, against singular poses
UP = np.array([0.0, 0.0, 1.0])


def move_gripper(world: World, state: np.void, target: np.ndarray, closing: np.ndarray) -> np.ndarray:
    """Action (7,) towards `target` (3,) [m] for the gripper point, pointing down, fingers closing along `closing` (3,).

    Damped least squares on position and orientation; the arm's redundancy is spent on staying near its rest pose.
    """
    twist = np.concatenate([_velocity(target - state["eef"]), ROTATION_GAIN * _rotation_error(world, closing)])
    jacobian = np.concatenate([world.gripper_jacobian(), world.gripper_rotation_jacobian()])  # (6, 7)
    return _action(world, twist, jacobian, REST_GAIN * (world.scene.rest_qpos - state["qpos"]))


def lean_gripper(world: World, state: np.void, target: np.ndarray, posture: np.ndarray) -> np.ndarray:
    """Action (7,) towards `target` (3,) [m] for the gripper point, turned as it comes.

    What the position leaves free of the joints goes towards `posture` (7,) [rad] off the rest pose.
    """
    pull = POSTURE_GAIN * (world.scene.rest_qpos + posture - state["qpos"])
    return _action(world, _velocity(target - state["eef"]), world.gripper_jacobian(), pull)


def _action(world: World, twist: np.ndarray, jacobian: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Action (7,) that makes `twist` (k,) [m/s, rad/s, in the world] by `jacobian` (k, 7), and pulls as it leaves room.

    Where a joint would be too fast the way is scaled as a whole, so that the direction stays. `pull` (7,) [rad/s] gets
    only what does not disturb the way and what it leaves of the joints' speed: scaled together, a long pull would slow
    the way to a third.
    """
    limit = world.scene.config.max_joint_velocity
    inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + DAMPING**2 * np.eye(len(twist)))  # (7, k)
    way = inverse @ twist  # [rad/s]
    way /= max(1.0, np.abs(way).max() / limit)
    free = pull - inverse @ (jacobian @ pull)
    room = (limit - np.sign(free) * way) / np.maximum(np.abs(free), 1e-9)
    return (way + min(1.0, room.min()) * free) / limit


def closing_direction(axes: np.ndarray, grasped: np.ndarray | None) -> np.ndarray:
    """Horizontal direction (3,) along which the fingers should close, as near as can be to the present one.

    `axes` is R_world_gripper (3, 3); `grasped` the cube's quaternion (w, x, y, z), to close on two of its sides, or
    None to leave the fingers as they are.
    """
    present = _horizontal(axes[:, 1])
    if grasped is None:
        return present
    side = _horizontal(matrix_of(grasped)[:, 0])
    other = _cross(UP, side)
    sides = np.array([side, -side, other, -other])
    return sides[np.argmax(sides @ present)]


def _horizontal(direction: np.ndarray) -> np.ndarray:
    """Unit vector of the horizontal part; the world's y where there is none."""
    flat = direction * [1.0, 1.0, 0.0]
    length = np.linalg.norm(flat)
    return flat / length if length > 1e-6 else np.array([0.0, 1.0, 0.0])


def _velocity(error: np.ndarray) -> np.ndarray:
    velocity = POSITION_GAIN * error
    return velocity / max(1.0, float(np.linalg.norm(velocity)) / MAX_SPEED)


def _rotation_error(world: World, closing: np.ndarray) -> np.ndarray:
    """Rotation vector (3,), to first order, from the gripper's axes to the wanted ones."""
    x, y, z = world.gripper_axes().T
    return 0.5 * (_cross(x, _cross(closing, -UP)) + _cross(y, closing) + _cross(z, -UP))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b of vectors (3,), as np.cross, which takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
