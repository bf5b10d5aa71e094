"""Everything the log says of a state: distances, estimation error, all rewards, success."""

from typing import NamedTuple

import numpy as np

from stages.policy import rewards


class Scores(NamedTuple):
    """Of n states; float64 [m] and rewards, NaN where there is no estimate."""

    distance_true: np.ndarray
    distance_est: np.ndarray
    estimation_error: np.ndarray
    reward_dense_true: np.ndarray
    reward_dense_est: np.ndarray
    reward_sparse: np.ndarray
    success: np.ndarray


def score(task: str, states: np.ndarray, cubes_est: np.ndarray) -> Scores:
    """Scores of states (n,) of STATE_DTYPE with estimated cube positions (n, 3) [m]."""
    touched, grasped, lifted = states["touched"], states["grasped"], states["lifted"]
    distance_true = np.linalg.norm(states["eef"] - states["cube_position"], axis=-1)
    distance_est = np.linalg.norm(states["eef"] - cubes_est, axis=-1)
    return Scores(
        distance_true=distance_true,
        distance_est=distance_est,
        estimation_error=np.linalg.norm(cubes_est - states["cube_position"], axis=-1),
        reward_dense_true=rewards.dense(task, distance_true, grasped, lifted),
        reward_dense_est=rewards.dense(task, distance_est, grasped, lifted),
        reward_sparse=rewards.sparse(task, distance_true, touched, grasped, lifted),
        success=rewards.succeeded(task, distance_true, touched, lifted),
    )
