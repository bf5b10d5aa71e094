"""Camera geometry against hand-made cases and invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stages.sim.camera import CameraPose, displaced, intrinsics, misaligned, nominal_pose, project, unproject
from stages.sim.config import CameraConfig

CONFIG = CameraConfig(image_size=128)
POSE, CAMERA = nominal_pose(CONFIG), intrinsics(CONFIG)
PIVOT = np.array(CONFIG.target)


def test_the_target_is_at_the_image_centre() -> None:
    assert np.allclose(project(PIVOT[None], POSE, CAMERA), [[64, 64]])


def test_a_point_at_the_edge_of_the_field_of_view_is_at_the_edge_of_the_image() -> None:
    """fovy = 90°: at depth 1 m the half-height is 1 m, so 1 m up is the upper edge, 1 m right the right one."""
    config = CameraConfig(image_size=100, fovy=90, position=(0, 0, 0), target=(1, 0, 0))
    points = np.array([[1.0, 0, 1.0], [1.0, -1.0, 0], [1.0, 0.5, -0.5]])
    pixels = project(points, nominal_pose(config), intrinsics(config))
    assert np.allclose(pixels, [[50, 0], [100, 50], [25, 75]])


@given(arrays(float, (5, 2), elements=st.floats(0, 128)), arrays(float, 5, elements=st.floats(0.1, 3)))
def test_unproject_inverts_project(pixels: np.ndarray, depth: np.ndarray) -> None:
    points = unproject(pixels, depth, POSE, CAMERA)
    assert np.allclose(project(points, POSE, CAMERA), pixels, atol=1e-6)
    assert np.allclose((points - POSE.position) @ POSE.rotation[:, 2], depth)


def test_rotations_are_right_handed_and_the_image_upright() -> None:
    for config in (CONFIG, CameraConfig(position=(0, 0, 2), target=(0, 0, 0.8))):
        rotation = nominal_pose(config).rotation
        assert np.allclose(rotation.T @ rotation, np.eye(3)) and np.isclose(np.linalg.det(rotation), 1)
    assert POSE.rotation[2, 1] < 0, "the image's down is the world's down"


@given(st.floats(-90, 90), st.sampled_from(["pan", "orbit"]))
def test_misalignment_turns_by_its_angle(degrees: float, kind: str) -> None:
    turned = misaligned(POSE, kind, degrees, PIVOT)
    cosine = (np.trace(POSE.rotation.T @ turned.rotation) - 1) / 2
    assert np.isclose(np.degrees(np.arccos(np.clip(cosine, -1, 1))), abs(degrees), atol=1e-4)


def test_pan_stays_in_place_and_orbit_keeps_looking_at_the_pivot() -> None:
    assert np.array_equal(misaligned(POSE, "pan", 10, PIVOT).position, POSE.position)
    orbit = misaligned(POSE, "orbit", 10, PIVOT)
    assert np.allclose(project(PIVOT[None], orbit, CAMERA), [[64, 64]])
    assert np.isclose(np.linalg.norm(orbit.position - PIVOT), np.linalg.norm(POSE.position - PIVOT))
    assert np.isclose(orbit.position[2], POSE.position[2])


def test_pan_shifts_the_image_by_focal_times_tangent() -> None:
    """A point on the optical axis moves sideways by f · tan(angle)."""
    pixel = project(PIVOT[None], misaligned(POSE, "pan", 5, PIVOT), CAMERA)[0]
    assert np.isclose(abs(pixel[0] - 64), CAMERA.focal * np.tan(np.radians(5)), atol=1e-6)
    assert np.isclose(pixel[1], 64)


def test_an_unknown_misalignment_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match="orbit, pan"):
        misaligned(POSE, "tilt", 5, PIVOT)


@given(st.integers(0, 2**31))
def test_displacement_stays_in_its_range(seed: int) -> None:
    moved = displaced(POSE, np.random.default_rng(seed), 0.01, 0.5)
    assert (np.abs(moved.position - POSE.position) <= 0.01).all()
    angle = np.degrees(np.arccos(np.clip((np.trace(POSE.rotation.T @ moved.rotation) - 1) / 2, -1, 1)))
    assert angle <= 0.5 * np.sqrt(3) + 1e-6


def test_quaternion_round_trip() -> None:
    again = CameraPose.from_quaternion(POSE.position, POSE.quaternion)
    assert np.allclose(again.rotation, POSE.rotation) and POSE.quaternion[0] >= 0
