"""Rotations against SciPy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from stages.sim.rotation import matrix_about, matrix_of, matrix_of_vector, quaternion_of, vector_of

QUATERNIONS = arrays(float, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
VECTORS = arrays(float, 3, elements=st.floats(-1.8, 1.8))  # [rad], none longer than π


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    turn = matrix_about(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    np.testing.assert_allclose(turn @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(quaternion_of(turn), [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


@given(QUATERNIONS)
def test_quaternions_are_scipys(quaternion: np.ndarray) -> None:
    theirs = Rotation.from_quat(quaternion, scalar_first=True)
    np.testing.assert_allclose(matrix_of(quaternion), theirs.as_matrix(), atol=1e-14)
    found = quaternion_of(theirs.as_matrix())
    np.testing.assert_allclose(matrix_of(found), theirs.as_matrix(), atol=1e-12)
    assert found[0] >= 0 and abs(np.linalg.norm(found) - 1) < 1e-12


@given(VECTORS)
def test_vectors_are_scipys(vector: np.ndarray) -> None:
    turn = matrix_of_vector(vector)
    np.testing.assert_allclose(turn, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrix_of_vector(vector_of(turn)), turn, atol=1e-7)
