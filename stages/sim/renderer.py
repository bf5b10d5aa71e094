"""Frames of the fixed camera (SPEC §3), nearly those of robosuite's own renderer at a small part of its cost.

robosuite's defaults spend a frame on 168 k visual faces, drawn again for a floor that reflects 1 % of them, with four
samples a pixel, whatever the image's size. Here what never moves is drawn once per camera pose and kept, with its
depth. A frame draws the moving geoms alone, decimated and only those in view, at 2 × 2 samples a pixel, and each sample
is theirs where they are nearer. Every frame is a function of positions and pose alone: the kept background is.
"""

from collections import OrderedDict
from copy import copy
from dataclasses import dataclass
from types import TracebackType

import mujoco
import numpy as np

from stages.sim.camera import CameraPose
from stages.sim.canvas import Canvas
from stages.sim.meshes import VISUAL_GROUP, LinkMesh, link_meshes, visual_model
from stages.sim.scene import Scene

__all__ = ["LinkMesh", "Renderer", "link_meshes"]

SUPERSAMPLING = 2  # samples per side of a pixel, of what moves; 3 comes a tenth nearer to robosuite, at twice the time
BACKGROUND_SAMPLES = 4  # robosuite's multisampling
KEPT_BYTES = 32 * 2**20  # of backgrounds: 431 poses at 64², 107 at 128²


@dataclass(frozen=True)
class Background:
    """What never moves, from one pose, bottom row first."""

    pixels: np.ndarray  # (H · W, 3) uint8
    depth: np.ndarray  # (S, S) float32, of every sample


class Renderer:
    """Renders one scene; owns an OpenGL context, so it belongs to one thread. Use as a context manager or `close`.

    Raises:
        MachineError: there is no OpenGL that needs no screen.
    """

    def __init__(self, scene: Scene, size: int, fovy: float) -> None:
        self._size, samples = size, size * SUPERSAMPLING
        model = copy(visual_model(scene))
        self._canvas = Canvas(model, size, BACKGROUND_SAMPLES, fovy)
        self._canvas.resize(samples, multisampled=False)
        visual, fixed = model.geom_group == VISUAL_GROUP, model.body_weldid[model.geom_bodyid] == 0
        self._moving, self._fixed = visual & ~fixed, visual & fixed
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._radii = np.where(plane, np.inf, model.geom_rbound)  # (ngeom,) [m] of spheres around the geoms
        self._sides = _frustum_sides(fovy)
        self._image = np.empty((samples, samples, 3), dtype=np.uint8)
        self._depth = np.empty((samples, samples), dtype=np.float32)
        self._first_sample = np.arange(samples**2).reshape(samples, samples)[::SUPERSAMPLING, ::SUPERSAMPLING].ravel()
        self._backgrounds: OrderedDict[bytes, Background] = OrderedDict()
        self._most_backgrounds = max(1, KEPT_BYTES // (3 * size**2 + self._depth.nbytes))

    def render(self, qpos: np.ndarray, pose: CameraPose) -> np.ndarray:
        """Image (H, W, 3) uint8 of the scene at generalised positions `qpos` (nq,) from `pose`."""
        self._canvas.place(qpos, pose)
        background = self._background(pose)
        self._canvas.select(self._moving & self._in_view(pose), sky=False)
        self._canvas.draw(self._image, self._depth)
        return self._composed(background)

    def close(self) -> None:
        """Free the OpenGL context; the renderer is of no use afterwards."""
        self._canvas.close()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _background(self, pose: CameraPose) -> Background:
        """The background from there, drawn if it is not among the last ones used."""
        key = pose.position.tobytes() + pose.rotation.tobytes()
        if key not in self._backgrounds:
            if len(self._backgrounds) == self._most_backgrounds:
                self._backgrounds.popitem(last=False)
            self._backgrounds[key] = self._draw_background(pose)
        self._backgrounds.move_to_end(key)
        return self._backgrounds[key]

    def _draw_background(self, pose: CameraPose) -> Background:
        """Colours of whole pixels, multisampled as robosuite's are; depth of every sample, to compare with."""
        canvas, size = self._canvas, self._size
        canvas.select(self._fixed & self._in_view(pose), sky=True)
        canvas.draw(self._image, self._depth)
        frame = np.empty((size, size, 3), dtype=np.uint8)
        canvas.resize(size, multisampled=True)
        canvas.draw(frame, None)
        canvas.resize(size * SUPERSAMPLING, multisampled=False)
        return Background(frame.reshape(-1, 3), self._depth.copy())

    def _in_view(self, pose: CameraPose) -> np.ndarray:
        """Which geoms' spheres reach into the image's pyramid (ngeom,); the others cannot have a pixel."""
        depths = (self._canvas.data.geom_xpos - pose.position) @ (pose.rotation @ self._sides)
        return (depths > -self._radii[:, None]).all(axis=1)

    def _composed(self, background: Background) -> np.ndarray:
        """Mean over each pixel's samples of what was drawn, or of the background where that is nearer."""
        nearer = self._depth > background.depth
        rows = nearer.reshape(self._size, SUPERSAMPLING, -1).any(axis=1)
        touched = np.flatnonzero(rows.view(f"u{SUPERSAMPLING}"))  # pixels: their samples in a row, read as one integer
        first, behind = self._first_sample.take(touched), background.pixels.take(touched, axis=0)
        total = np.full(behind.shape, SUPERSAMPLING**2 // 2, dtype=np.uint16)  # half of the divisor, to round
        for row, column in np.ndindex(SUPERSAMPLING, SUPERSAMPLING):
            sample = first + (row * self._size * SUPERSAMPLING + column)
            drawn = self._image.reshape(-1, 3).take(sample, axis=0)
            total += np.where(nearer.take(sample)[:, None], drawn, behind)
        frame = background.pixels.copy()
        frame[touched] = total // SUPERSAMPLING**2
        return frame.reshape(self._size, self._size, 3)[::-1].copy()  # OpenGL's rows go upwards


def _frustum_sides(fovy: float) -> np.ndarray:
    """Inward normals (3, 4), in the optical frame, of the four planes that bound what a square image shows."""
    sine, cosine = np.sin(np.radians(fovy) / 2), np.cos(np.radians(fovy) / 2)
    return np.array([[cosine, -cosine, 0, 0], [0, 0, cosine, -cosine], [sine, sine, sine, sine]])
