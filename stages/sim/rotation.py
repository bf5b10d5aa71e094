"""Rotations of one body at a time, by MuJoCo's own functions. Quaternions are (w, x, y, z), as MuJoCo's.

SciPy's `Rotation` would do as well, but importing it takes a third of a second of every command that shows an episode.
"""

import mujoco
import numpy as np


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (4,) of any length but 0."""
    unit = np.array(quaternion, dtype=np.float64)
    mujoco.mju_normalize4(unit)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, unit)
    return matrix.reshape(3, 3)


def quaternion_of(matrix: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,), w ≥ 0, of a rotation matrix (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix, dtype=np.float64).ravel())
    return -quaternion if quaternion[0] < 0 else quaternion


def matrix_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by `angle` [rad] about a unit vector (3,)."""
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.asarray(axis, dtype=np.float64), angle)
    return matrix_of(quaternion)


def matrix_of_vector(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a rotation vector (3,): its direction the axis, its length the angle [rad]."""
    angle = float(np.linalg.norm(vector))
    return matrix_about(vector / angle, angle) if angle else np.eye(3)


def vector_of(matrix: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] of a rotation matrix (3, 3)."""
    vector = np.empty(3)
    mujoco.mju_quat2Vel(vector, quaternion_of(matrix), 1.0)
    return vector
