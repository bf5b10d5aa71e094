"""Coarser visual meshes, for pictures and viewers: robosuite's have 136 k to 293 k faces, for arms of a few pixels.

They make a second compiled model, so the physics' model keeps every mesh.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import fast_simplification
import mujoco
import numpy as np

from stages.sim import scene_cache
from stages.sim.scene import Scene

VISUAL_GROUP = 1  # robosuite: visual geoms in group 1, collision geoms in group 0
KEPT_FACES = 0.04  # share of a visual mesh's faces that decimation aims at
MIN_FACES = 100  # a mesh is not decimated below this
AGGRESSIVENESS = 2  # of fast_simplification; its default 7 tears the gripper, the elbow and the pedestal
FLOOR_BRIGHTENING = 1.04  # measured at the default camera


@dataclass(frozen=True)
class LinkMesh:
    """A visual mesh, rigidly attached to a link."""

    link: str  # body name
    vertices: np.ndarray  # (n, 3) [m], in the link's frame
    triangles: np.ndarray  # (m, 3) indices
    rgba: np.ndarray  # (4,) in 0…1


def link_meshes(scene: Scene) -> list[LinkMesh]:
    """Decimated visual meshes of the robot, for viewers; boxes and planes are left to the caller."""
    model = visual_model(scene)
    geoms = np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH))
    return [_link_mesh(model, int(geom)) for geom in geoms]


@lru_cache(maxsize=2)
def visual_model(scene: Scene) -> Any:
    """The scene compiled with decimated visual meshes, or as it was kept on disk. Shared: never modified."""
    return scene_cache.kept("visual", scene.config, lambda: (_compile(scene), {}))[0]


def _compile(scene: Scene) -> Any:
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
    return bool(users.any()) and bool((model.geom_group[users] == VISUAL_GROUP).all())


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
