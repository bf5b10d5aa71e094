"""The fast world against stock robosuite, and what its signals mean."""

import mujoco
import numpy as np
import pytest

from schemas.errors import ArtifactError
from stages.sim.config import WorldConfig
from stages.sim.gripper import closed_gripper_qpos, gripper_point_offset
from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT, Scene, build_scene, make_environment
from stages.sim.state import STATE_DTYPE, pack_state, unpack_state
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(WorldConfig())


def _initial(scene: Scene, task: str, seed: int = 0) -> np.ndarray:
    return sample_initial_state(scene, task, np.random.default_rng(seed))


@pytest.mark.parametrize("task", ["reach", "lift"])
def test_trajectories_equal_stock_robosuite(scene: Scene, task: str) -> None:
    """SPEC §3: 200 steps from the same state and actions agree to 1e-9 in everything the future depends on."""
    stock = make_environment(scene.config)
    stock.reset()
    data, model = stock.sim.data._data, stock.sim.model._model
    world, initial = World(scene, task), _initial(scene, task)
    world.reset(initial)
    unpack_state(model, data, initial)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(1)
    moved = 0.0
    for _ in range(200):
        action = rng.uniform(-1, 1, world.action_dim).astype(np.float32)
        stock.step(np.append(action, 1.0) if task == "reach" else action.astype(float))
        state = world.step(action)
        assert np.abs(world.integration_state() - pack_state(model, data)).max() <= 1e-9
        moved = max(moved, float(np.abs(state["qpos"] - scene.rest_qpos).max()))
    assert moved > 0.05, "the arm must have moved for the comparison to mean anything"
    assert stock._check_success() == state["lifted"]


def test_gripper_point_is_the_fingertips_in_reach_and_the_grip_site_in_lift(scene: Scene) -> None:
    """SPEC §5: the end of the closed Panda gripper is about 0.9 cm beyond grip_site."""
    assert gripper_point_offset(scene, "reach") == pytest.approx(0.009, abs=0.001)
    assert gripper_point_offset(scene, "lift") == 0
    assert np.abs(closed_gripper_qpos(scene)).max() < 0.002


def test_reset_distribution(scene: Scene) -> None:
    """Cube within ±15 cm, resting on the table; joints around the rest pose; every episode different."""
    cubes, joints = [], []
    for seed in range(50):
        state = World(scene, "reach").reset(_initial(scene, "reach", seed))
        cubes.append(state["cube_position"].copy())
        joints.append(state["qpos"].copy())
    x, y, z = np.array(cubes).T
    assert np.abs([x, y]).max() <= 0.15 and np.abs([x, y]).max() > 0.12
    assert np.allclose(z, TABLE_HEIGHT + CUBE_HALF_SIZE)
    assert np.std(np.array(joints) - scene.rest_qpos) == pytest.approx(0.02, rel=0.2)


def test_holding_still_for_an_episode(scene: Scene) -> None:
    """Zero velocity: time advances 50 ms a step, the cube rests, the closed gripper stays closed, nothing touches."""
    world = World(scene, "reach")
    first = world.reset(_initial(scene, "reach"))
    for _ in range(20):
        last = world.step(np.zeros(7))
    assert last["time_ns"] == 20 * 50_000_000
    assert np.allclose(last["cube_position"], first["cube_position"], atol=1e-3)
    assert np.allclose(last["qpos"], first["qpos"], atol=2e-3)
    assert last["gripper_opening"] == pytest.approx(first["gripper_opening"], abs=1e-3)
    assert not any(last[flag] for flag in ("touched", "grasped", "lifted", "unstable"))


def test_same_state_and_actions_give_the_same_bits(scene: Scene) -> None:
    initial, rng = _initial(scene, "lift"), np.random.default_rng(3)
    actions = rng.uniform(-1, 1, (10, 8)).astype(np.float32)
    ends = []
    for _ in range(2):
        world = World(scene, "lift")
        world.reset(initial)
        for action in actions:
            world.step(action)
        ends.append(world.integration_state())
    assert np.array_equal(*ends)


def test_touch_is_judged_by_contact(scene: Scene) -> None:
    """Put the cube between the fingertips: they touch it; far away they do not."""
    world = World(scene, "reach")
    initial = _initial(scene, "reach")
    eef = world.reset(initial)["eef"].copy()
    assert not world.state()["touched"]
    data = mujoco.MjData(scene.model)
    unpack_state(scene.model, data, initial)
    data.qpos[scene.cube_qpos : scene.cube_qpos + 3] = eef
    assert world.reset(pack_state(scene.model, data))["touched"]


def test_jacobian_agrees_with_finite_differences(scene: Scene) -> None:
    world, initial = World(scene, "reach"), _initial(scene, "reach")
    world.reset(initial)
    jacobian, eef = world.gripper_jacobian(), world.state()["eef"].copy()
    for joint in range(7):
        data = mujoco.MjData(scene.model)
        unpack_state(scene.model, data, initial)
        data.qpos[scene.arm_qpos[joint]] += 1e-6
        moved = world.reset(pack_state(scene.model, data))["eef"]
        assert np.allclose((moved - eef) / 1e-6, jacobian[:, joint], atol=1e-4)


def test_a_diverging_scene_says_so(scene: Scene) -> None:
    """A NaN velocity is found by MuJoCo, which resets the scene by itself: the world must not pass that off as data."""
    world, initial = World(scene, "reach"), _initial(scene, "reach")
    data = mujoco.MjData(scene.model)
    unpack_state(scene.model, data, initial)
    data.qvel[0] = np.nan
    world.reset(pack_state(scene.model, data))
    assert world.step(np.zeros(7))["unstable"]


def test_a_state_of_another_scene_is_refused(scene: Scene) -> None:
    with pytest.raises(ArtifactError, match="another robot"):
        World(scene, "reach").reset(np.zeros(5))


@pytest.mark.parametrize("robot", ["Sawyer", "IIWA", "Kinova3"])
def test_other_arms_reach_and_close(robot: str) -> None:
    """Any 7-DoF robosuite arm by name, against stock robosuite for a second."""
    scene = build_scene(WorldConfig(robot=robot))
    world, stock = World(scene, "lift"), make_environment(scene.config)
    stock.reset()
    initial = _initial(scene, "lift")
    world.reset(initial)
    unpack_state(stock.sim.model._model, stock.sim.data._data, initial)
    mujoco.mj_forward(stock.sim.model._model, stock.sim.data._data)
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, 8)
        stock.step(action)
        state = world.step(action)
    assert np.abs(world.qpos_full() - stock.sim.data._data.qpos).max() <= 1e-9
    assert state.dtype == STATE_DTYPE and not state["unstable"]
    assert 0 < gripper_point_offset(scene, "reach") < 0.1
