"""The cube as lines in the image."""

from itertools import pairwise

import numpy as np

from stages.replay.projection import cube_edges, in_image
from stages.sim.camera import intrinsics, nominal_pose
from stages.sim.config import CameraConfig

CONFIG = CameraConfig(image_size=100, position=(0.0, 0.0, 1.825), target=(0.0, 0.0, 0.8))
POSE, INTRINSICS = nominal_pose(CONFIG), intrinsics(CONFIG)
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


def test_the_point_the_camera_looks_at_is_the_image_centre():
    assert np.allclose(in_image(np.array([[[0.0, 0.0, 0.8]]]), POSE, INTRINSICS), [[[50.0, 50.0]]])


def test_one_line_walks_all_twelve_edges_of_the_cube():
    line = cube_edges(np.array([[0.0, 0.0, 0.8]]), UPRIGHT, POSE, INTRINSICS)[0]
    edges = {frozenset(map(tuple, np.round(pair, 6))) for pair in pairwise(line)}
    assert len(edges) == 12


def test_top_face_from_straight_above_has_its_size_over_its_distance():
    line = cube_edges(np.array([[0.0, 0.0, 0.8]]), UPRIGHT, POSE, INTRINSICS)[0]
    # the top face is 1 m below the camera: half of 5 cm at 1 m is 0.025 focal lengths
    assert np.isclose(np.abs(line - 50).max(), 0.025 * INTRINSICS.focal)


def test_turning_the_cube_by_a_quarter_changes_nothing():
    position = np.array([[0.1, -0.05, 0.825]])
    quarter = np.array([[np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)]])
    corners = [
        {tuple(point) for point in cube_edges(position, turn, POSE, INTRINSICS)[0].round(6)}
        for turn in (UPRIGHT, quarter)
    ]
    assert corners[0] == corners[1]
