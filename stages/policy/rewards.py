"""The paper's rewards (equations 3 to 6), as pure functions of distance and of the simulator's signals.

d is the distance between gripper point and cube centre [m]. From the estimated position it is the noisy reward, from
the true one the evaluation's. Touch, grasp and lift are judged by the simulator: they are free of noise.
"""

import numpy as np

TOUCH_DISTANCE = 0.03  # [m] paper §V-B: within 3 cm of the block's centre
DENSE_SLOPE = 10.0  # [1/m] equations 3 and 5
GRASPED_DENSE, GRASPED_SPARSE, LIFTED = 1.0, 1.25, 2.25


def reach_completed(distance_true: np.ndarray, touched: np.ndarray) -> np.ndarray:
    """Paper §V-B: the gripper's end touches the cube, or is within 3 cm of its centre."""
    return touched | (distance_true <= TOUCH_DISTANCE)


def approach(distance: np.ndarray) -> np.ndarray:
    """1 − tanh(10 d): 1 on the cube's centre, 0.24 at 10 cm."""
    return 1.0 - np.tanh(DENSE_SLOPE * distance)


def reach_dense(distance: np.ndarray) -> np.ndarray:
    """Equation 3."""
    return np.where(distance <= TOUCH_DISTANCE, 1.0, approach(distance))


def reach_sparse(completed: np.ndarray) -> np.ndarray:
    """Equation 4, with the completion of §V-B."""
    return np.where(completed, 1.0, 0.0)


def lift_dense(distance: np.ndarray, grasped: np.ndarray, lifted: np.ndarray) -> np.ndarray:
    """Equation 5."""
    return np.where(lifted, LIFTED, np.where(grasped, GRASPED_DENSE, approach(distance)))


def lift_sparse(touched: np.ndarray, grasped: np.ndarray, lifted: np.ndarray) -> np.ndarray:
    """Equation 6."""
    return np.where(lifted, LIFTED, np.where(grasped, GRASPED_SPARSE, np.where(touched, 1.0, 0.0)))


def dense(task: str, distance: np.ndarray, grasped: np.ndarray, lifted: np.ndarray) -> np.ndarray:
    """The task's dense reward."""
    return lift_dense(distance, grasped, lifted) if task == "lift" else reach_dense(distance)


def sparse(
    task: str, distance_true: np.ndarray, touched: np.ndarray, grasped: np.ndarray, lifted: np.ndarray
) -> np.ndarray:
    """The task's sparse reward."""
    if task == "lift":
        return lift_sparse(touched, grasped, lifted)
    return reach_sparse(reach_completed(distance_true, touched))


def succeeded(task: str, distance_true: np.ndarray, touched: np.ndarray, lifted: np.ndarray) -> np.ndarray:
    """Whether the task is completed in this state."""
    return lifted.copy() if task == "lift" else reach_completed(distance_true, touched)
