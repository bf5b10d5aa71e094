"""Cubes as a camera sees them."""

import numpy as np

from stages.sim.camera import CameraPose, Intrinsics, project
from stages.sim.rotation import matrix_of
from stages.sim.scene import CUBE_HALF_SIZE

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * CUBE_HALF_SIZE  # (8, 3)
_EDGE_WALK = [0, 1, 3, 2, 0, 4, 5, 7, 6, 4, 5, 1, 3, 7, 6, 2]  # one line along all twelve edges


def cube_edges(position: np.ndarray, quaternion: np.ndarray, camera: CameraPose, intrinsics: Intrinsics) -> np.ndarray:
    """Edges of cubes at `position` (n, 3) [m], `quaternion` (n, 4) wxyz, as one line each: (n, 16, 2) [pixels]."""
    turned = np.stack([matrix_of(each) for each in quaternion])  # (n, 3, 3)
    corners = position[:, None] + np.einsum("nij,kj->nki", turned, _CORNERS)  # (n, 8, 3)
    return in_image(corners, camera, intrinsics)[:, _EDGE_WALK]


def in_image(points: np.ndarray, camera: CameraPose, intrinsics: Intrinsics) -> np.ndarray:
    """World points (n, k, 3) [m] → (n, k, 2) [pixels]."""
    return project(points.reshape(-1, 3), camera, intrinsics).reshape(*points.shape[:2], 2)
