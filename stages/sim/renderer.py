"""Frames of the fixed camera (SPEC §3), and the meshes a viewer shows.

robosuite's defaults spend a frame on 168 k visual faces, drawn again for a floor that reflects 1 % of them, with four
samples a pixel, whatever the image's size. Here the visual meshes are decimated, without reflection and multisampling:
nearly the same picture at 64 or 128 pixels. It is a second compiled model, so the physics' model keeps every mesh.
No light of robosuite's arenas casts a shadow, so there is no shadow map.
"""

from dataclasses import dataclass
from functools import lru_cache
from types import TracebackType
from typing import Any

import fast_simplification
import mujoco
import numpy as np

from stages.sim.camera import CameraPose
from stages.sim.gl import make_context
from stages.sim.scene import Scene

KEPT_FACES = 0.04  # share of a visual mesh's faces that decimation aims at
MIN_FACES = 100  # a mesh is not decimated below this
MAX_FACES = 2000  # a mesh above this after careful decimation is decimated again, carelessly
FLOOR_BRIGHTENING = 1.04  # measured at the default camera
AGGRESSIVENESS = 2  # of fast_simplification; its default 7 tears the gripper and the elbow (pixel difference doubles)
_VISUAL_GROUP = 1  # robosuite: visual geoms in group 1, collision geoms in group 0
_OPTICAL_TO_GL = np.diag([1.0, -1.0, -1.0])  # OpenGL cameras have y up and look along −z


@dataclass(frozen=True)
class LinkMesh:
    """A visual mesh, rigidly attached to a link."""

    link: str  # body name
    vertices: np.ndarray  # (n, 3) [m], in the link's frame
    triangles: np.ndarray  # (m, 3) indices
    rgba: np.ndarray  # (4,) in 0…1


class Renderer:
    """Renders one scene; owns an OpenGL context, so it belongs to one thread. Use as a context manager or `close`.

    Raises:
        MachineError: there is no OpenGL that needs no screen.
    """

    def __init__(self, scene: Scene, size: int, fovy: float) -> None:
        self._context = make_context(size)
        self._model = visual_model(scene)
        self._fovy = fovy
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=2 * self._model.ngeom)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = [group == _VISUAL_GROUP for group in range(len(self._options.geomgroup))]
        self._options.sitegroup[:] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        self._viewport = mujoco.MjrRect(0, 0, size, size)
        self._gl = self._make_gl(size)
        self._image = np.empty((size, size, 3), dtype=np.uint8)

    def render(self, qpos: np.ndarray, pose: CameraPose) -> np.ndarray:
        """Image (H, W, 3) uint8 of the scene at generalised positions `qpos` (nq,) from `pose`."""
        self._context.make_current()  # another renderer of this thread may have drawn since
        model, data = self._model, self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        model.cam_fovy[0] = self._fovy
        data.cam_xpos[0] = pose.position
        data.cam_xmat[0] = (pose.rotation @ _OPTICAL_TO_GL).ravel()
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(model, data, self._options, None, self._camera, everything, self._scene)
        mujoco.mjr_render(self._viewport, self._scene, self._gl)
        mujoco.mjr_readPixels(self._image, None, self._viewport, self._gl)
        return self._image[::-1].copy()  # OpenGL's rows go upwards

    def close(self) -> None:
        """Free the OpenGL context; the renderer is of no use afterwards."""
        self._gl.free()
        self._context.free()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _make_gl(self, size: int) -> Any:
        self._model.vis.global_.offwidth = self._model.vis.global_.offheight = size
        self._model.vis.quality.offsamples = 0
        self._model.vis.quality.shadowsize = 0
        gl = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        return gl


def link_meshes(scene: Scene) -> list[LinkMesh]:
    """Decimated visual meshes of the robot, for viewers; boxes and planes are left to the caller."""
    model = visual_model(scene)
    geoms = np.flatnonzero((model.geom_group == _VISUAL_GROUP) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH))
    return [_link_mesh(model, int(geom)) for geom in geoms]


@lru_cache(maxsize=2)
def visual_model(scene: Scene) -> Any:
    """The scene compiled with decimated visual meshes: for pictures only."""
    spec = mujoco.MjSpec.from_string(scene.xml)
    for mesh in spec.meshes:
        original = scene.model.mesh(mesh.name)
        if int(original.facenum[0]) > MIN_FACES and _is_visual(scene.model, original.id):
            _decimate(mesh, scene.model, original)
    model = spec.compile()
    _brighten_floor(model)
    return model


def _brighten_floor(model: Any) -> None:
    """Give the floor's texture the light that its reflection of the sky would add, so that it need not be drawn."""
    material = model.geom_matid[model.geom("floor").id]
    texture = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB])
    start = model.tex_adr[texture]
    pixels = model.tex_data[start : start + model.tex_width[texture] * model.tex_height[texture] * 3]
    pixels[:] = np.minimum(pixels * FLOOR_BRIGHTENING, 255)


def _is_visual(model: Any, mesh: int) -> bool:
    users = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.geom_dataid == mesh)
    return bool(users.any()) and bool((model.geom_group[users] == _VISUAL_GROUP).all())


def _decimate(mesh: Any, model: Any, original: Any) -> None:
    """Replace a mesh of the spec by a coarser one in the same frame."""
    start, count = int(original.vertadr[0]), int(original.vertnum[0])
    first, faces = int(original.faceadr[0]), int(original.facenum[0])
    # compiling centred and turned the vertices; undo it, for compiling again will centre and turn the coarse mesh
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.mesh_quat[original.id])
    vertices = model.mesh_vert[start : start + count] @ rotation.reshape(3, 3).T + model.mesh_pos[original.id]
    vertices, triangles = _weld(vertices, model.mesh_face[first : first + faces])
    wanted = max(int(KEPT_FACES * faces), MIN_FACES)
    vertices, triangles = fast_simplification.simplify(vertices, triangles, target_count=wanted, agg=AGGRESSIVENESS)
    if len(triangles) > MAX_FACES:  # the pedestal, hidden by the table, else has half of all faces
        vertices, triangles = fast_simplification.simplify(vertices, triangles, target_count=wanted)
    mesh.file, mesh.scale = "", [1, 1, 1]
    mesh.uservert, mesh.userface = vertices.ravel().tolist(), triangles.ravel().tolist()


def _weld(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join vertices at the same place: .obj files repeat them along every crease, which would tear when decimated."""
    unique, index = np.unique(vertices.round(6), axis=0, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    proper = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return unique.astype(np.float32), triangles[proper].astype(np.int32)


def _link_mesh(model: Any, geom: int) -> LinkMesh:
    mesh = model.mesh(model.geom_dataid[geom])
    start, first = int(mesh.vertadr[0]), int(mesh.faceadr[0])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    vertices = model.mesh_vert[start : start + int(mesh.vertnum[0])] @ rotation.reshape(3, 3).T
    material = model.geom_matid[geom]
    return LinkMesh(
        link=model.body(model.geom_bodyid[geom]).name,
        vertices=vertices + model.geom_pos[geom],
        triangles=model.mesh_face[first : first + int(mesh.facenum[0])].copy(),
        rgba=(model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).copy(),
    )
