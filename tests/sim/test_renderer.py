"""Frames: the picture that drawing everything at once would give, whatever was drawn before, near robosuite's own."""

from collections.abc import Iterator
from copy import copy
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import stages.sim  # noqa: F401  # chooses the OpenGL backend before MuJoCo is imported
from benchmarks.render import StockCamera
from stages.sim import renderer as renderer_module
from stages.sim.camera import CameraPose, displaced, misaligned, nominal_pose
from stages.sim.canvas import Canvas
from stages.sim.config import CameraConfig, Robot, WorldConfig
from stages.sim.meshes import VISUAL_GROUP, visual_model
from stages.sim.renderer import SUPERSAMPLING, Renderer, link_meshes
from stages.sim.scene import Scene, build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World

CAMERA = CameraConfig(image_size=64)
NOMINAL = nominal_pose(CAMERA)
TURNED = misaligned(NOMINAL, "orbit", 10, np.array(CAMERA.target))
CLOSE = nominal_pose(CameraConfig(position=(0.4, 0.3, 1.0)))
POSES = [NOMINAL, TURNED, misaligned(NOMINAL, "pan", -10, np.array(CAMERA.target)), CLOSE]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(WorldConfig())


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> Iterator[Renderer]:
    with Renderer(scene, CAMERA.image_size, CAMERA.fovy) as made:
        yield made


def _states(scene: Scene) -> list[np.ndarray]:
    """Generalised positions along an episode of random actions held for a while."""
    world, rng, found = World(scene, "lift"), np.random.default_rng(0), []
    world.reset(sample_initial_state(scene, "lift", rng))
    for _ in range(4):
        found.append(world.qpos_full())
        action = rng.uniform(-1, 1, 8)
        for _ in range(15):
            world.step(action)
    return found


def _whole_scene(scene: Scene, qpos: np.ndarray, pose: CameraPose, size: int) -> np.ndarray:
    """All visual geoms in one drawing, one sample per pixel, top row first."""
    model = copy(visual_model(scene))
    visual = model.geom_group == VISUAL_GROUP
    canvas = Canvas(model, size, 0, CAMERA.fovy)
    canvas.place(qpos, pose)
    canvas.select(visual, sky=True)
    image = np.empty((size, size, 3), dtype=np.uint8)
    canvas.draw(image, None)
    canvas.close()
    return image[::-1]


def _is_red(image: np.ndarray) -> np.ndarray:
    """Where the cube is (H, W)."""
    return image[:, :, 0] > 2 * image[:, :, 1]


@pytest.mark.parametrize("pose", POSES)
def test_a_frame_is_the_drawing_of_everything_at_once(
    scene: Scene, pose: CameraPose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one sample per pixel, culling, the kept background and the comparison of depths change no pixel."""
    monkeypatch.setattr(renderer_module, "SUPERSAMPLING", 1)
    monkeypatch.setattr(renderer_module, "BACKGROUND_SAMPLES", 0)
    with Renderer(scene, CAMERA.image_size, CAMERA.fovy) as plain:
        for qpos in _states(scene):
            assert np.array_equal(plain.render(qpos, pose), _whole_scene(scene, qpos, pose, CAMERA.image_size))


def test_pixels_are_means_of_their_samples(scene: Scene, renderer: Renderer) -> None:
    """Where nothing of the background shows, a pixel is the mean of the samples that a larger drawing has there."""
    qpos, size = _states(scene)[2], CAMERA.image_size
    large = _whole_scene(scene, qpos, CLOSE, size * SUPERSAMPLING).astype(int)
    means = (large.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).sum(axis=(1, 3)) + 2) // SUPERSAMPLING**2
    frame = renderer.render(qpos, CLOSE).astype(int)
    red = _is_red(large).reshape(size, SUPERSAMPLING, size, SUPERSAMPLING).all(axis=(1, 3))
    assert red.sum() > 50, "the cube must be in view"
    assert np.array_equal(frame[red], means[red])


def test_frames_do_not_depend_on_what_was_drawn_before(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another order, another renderer in between, and a cache of one background: the same bytes."""
    jobs = [(qpos, pose) for qpos in _states(scene) for pose in POSES]
    with Renderer(scene, 64, CAMERA.fovy) as first:
        expected = [first.render(*job) for job in jobs]
    monkeypatch.setattr(renderer_module, "KEPT_BYTES", 1)
    with Renderer(scene, 64, CAMERA.fovy) as second, Renderer(scene, 32, CAMERA.fovy) as other:
        for job, frame in reversed(list(zip(jobs, expected, strict=True))):
            other.render(*job)
            assert np.array_equal(second.render(*job), frame)
        assert len(second._backgrounds) == 1


def test_closing_a_renderer_leaves_the_others_alone(scene: Scene, renderer: Renderer) -> None:
    qpos, rng = _states(scene)[1], np.random.default_rng(1)
    new_pose = displaced(NOMINAL, rng, 0.02, 2.0)
    with Renderer(scene, CAMERA.image_size, CAMERA.fovy) as other:
        expected = other.render(qpos, new_pose)
        renderer.render(qpos, NOMINAL)  # is current when the other closes
    assert np.array_equal(renderer.render(qpos, new_pose), expected)


def test_backgrounds_are_kept_within_bounds(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The least recently used pose goes first."""
    monkeypatch.setattr(renderer_module, "KEPT_BYTES", 2 * (32 * 32 * 3 + 64 * 64 * 4))
    qpos, rng = _states(scene)[0], np.random.default_rng(0)
    with Renderer(scene, 32, CAMERA.fovy) as small:
        small.render(qpos, NOMINAL)
        for _ in range(5):
            small.render(qpos, displaced(NOMINAL, rng, 0.02, 2.0))
            kept = small._background(NOMINAL)
            assert small._background(NOMINAL) is kept and len(small._backgrounds) == 2


@pytest.mark.parametrize("robot", ["Panda", "Sawyer", "IIWA", "Kinova3"])
def test_frames_are_near_robosuites(robot: Robot) -> None:
    """Mean difference to the stock renderer with its defaults, every robot; the cube is where it is there."""
    scene, stock = build_scene(WorldConfig(robot=robot)), StockCamera(WorldConfig(robot=robot), CAMERA.fovy)
    qpos = _states(scene)[1]
    expected = stock.render(qpos, NOMINAL, 128).astype(int)
    stock.close()
    with Renderer(scene, 128, CAMERA.fovy) as ours:
        found = ours.render(qpos, NOMINAL).astype(int)
    assert np.abs(found - expected).mean() <= 2
    assert (_is_red(found) & _is_red(expected)).sum() > 0.8 * _is_red(expected).sum() > 50


def test_viewer_meshes_lie_on_the_original_surfaces(scene: Scene) -> None:
    """Vertices are near the original ones, every link keeps its extent, and few faces are left."""
    model = scene.model
    meshes = link_meshes(scene)
    geoms = np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_dataid >= 0))
    assert len(meshes) == len(geoms)
    assert sum(len(mesh.triangles) for mesh in meshes) < 0.2 * model.mesh_facenum[model.geom_dataid[geoms]].sum()
    for link in {mesh.link for mesh in meshes}:
        own = [geom for geom in geoms if model.body(model.geom_bodyid[geom]).name == link]
        original = np.concatenate([_vertices(model, geom) for geom in own])
        found = np.concatenate([mesh.vertices for mesh in meshes if mesh.link == link])
        assert np.median(cKDTree(original).query(found)[0]) < 0.005
        assert np.abs(found.min(axis=0) - original.min(axis=0)).max() < 0.005
        assert np.abs(found.max(axis=0) - original.max(axis=0)).max() < 0.005


def _vertices(model: Any, geom: int) -> np.ndarray:
    """Of a geom's mesh, in its link's frame (n, 3) [m]."""
    start, count = model.mesh_vertadr[model.geom_dataid[geom]], model.mesh_vertnum[model.geom_dataid[geom]]
    turn = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    return turn.apply(model.mesh_vert[start : start + count]) + model.geom_pos[geom]
