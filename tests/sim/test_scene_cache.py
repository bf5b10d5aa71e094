"""Compiled scenes kept on disk: the same bits as compiled anew, and made again where they are damaged."""

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stages.sim import scene_cache
from stages.sim.config import WorldConfig
from stages.sim.gripper import gripper_control
from stages.sim.meshes import visual_model
from stages.sim.robosuite_scene import make_environment
from stages.sim.scene import Facts, Scene, build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World

CONFIG = WorldConfig()


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def kept_here(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIPELINE_CACHE", str(root))


def built(config: WorldConfig = CONFIG) -> Scene:
    """As a new process builds it."""
    return build_scene.__wrapped__(config)


def as_bytes(model: object, directory: Path) -> bytes:
    mujoco.mj_saveModel(model, str(directory / "x.mjb"), None)
    return (directory / "x.mjb").read_bytes()


def entry(root: Path) -> Path:
    [directory] = root.iterdir()
    return directory


@pytest.fixture(scope="module")
def compiled(root: Path) -> Scene:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(root))
        return built()


def test_what_was_kept_is_what_was_compiled(compiled: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stages.sim.robosuite_scene.compile_scene", lambda config: pytest.fail("compiled again"))
    loaded = built()
    assert as_bytes(loaded.model, tmp_path) == as_bytes(compiled.model, tmp_path)
    for field in dataclasses.fields(Facts):
        one, other = getattr(compiled, field.name), getattr(loaded, field.name)
        if field.name == "gains":
            one, other = vars(one), vars(other)
        np.testing.assert_equal(other, one)
        if isinstance(one, np.ndarray):
            assert other.dtype == one.dtype, field.name


def test_episodes_are_the_same_bits(compiled: Scene) -> None:
    states = []
    for scene in (compiled, built()):
        world, rng = World(scene, "lift"), np.random.default_rng(3)
        world.reset(sample_initial_state(scene, "lift", rng))
        for _ in range(20):
            world.step(rng.uniform(-1, 1, 8).astype(np.float32))
        states.append(world.integration_state())
    assert np.array_equal(*states)


def test_visual_models_are_kept_too(compiled: Scene, root: Path, tmp_path: Path) -> None:
    first = visual_model.__wrapped__(compiled)
    assert (entry(root) / "visual.mjb").is_file()
    assert as_bytes(visual_model.__wrapped__(compiled), tmp_path) == as_bytes(first, tmp_path)


@pytest.mark.parametrize("file", ["scene.mjb", "scene.json"])
@pytest.mark.parametrize("damage", [lambda x: x[:-100], lambda x: b"", lambda x: x[:50] + b"\xff" + x[51:]])
def test_a_damaged_entry_is_made_again(compiled: Scene, root: Path, tmp_path: Path, file: str, damage) -> None:
    path = entry(root) / file
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    again = built()
    assert np.array_equal(again.arm_qpos, compiled.arm_qpos)
    assert as_bytes(again.model, tmp_path) == as_bytes(compiled.model, tmp_path)
    assert scene_cache._load(entry(root), "scene") is not None


def test_nothing_is_kept_where_none_is_wanted_or_may_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls = []

    def make() -> tuple[object, dict]:
        calls.append(1)
        return mujoco.MjModel.from_xml_string("<mujoco/>"), {}

    monkeypatch.setenv("PIPELINE_CACHE", "")
    scene_cache.kept("x", CONFIG, make)
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "file"))
    scene_cache.kept("x", CONFIG, make)
    assert len(calls) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_another_configuration_of_the_model_is_another_entry(root: Path) -> None:
    own = scene_cache._directory(CONFIG)
    assert scene_cache._directory(WorldConfig(horizon=10, touch="pads", cube_half_range=0.1)) == own
    assert scene_cache._directory(WorldConfig(max_joint_velocity=0.3)) != own
    assert scene_cache._directory(WorldConfig(robot="Sawyer")) != own


@pytest.mark.parametrize("robot", ["Panda", "Sawyer", "IIWA", "Kinova3"])
def test_the_gripper_ramps_as_robosuites(robot: str) -> None:
    config = WorldConfig(robot=robot)  # type: ignore[arg-type]
    scene, environment = build_scene(config), make_environment(config)
    gripper = environment.robots[0].gripper["right"]
    gripper.current_action = np.zeros(gripper.dof)
    goal = np.zeros(len(scene.gripper_ramp))
    for command in np.random.default_rng(0).uniform(-1, 1, 300).cumsum().clip(-1, 1):
        expected = np.array(gripper.format_action(np.array([command])), dtype=float)
        goal, _ = gripper_control(scene, goal, np.array([command]))
        assert np.array_equal(goal, expected)
    environment.close()
