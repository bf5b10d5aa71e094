"""The fast world against stock robosuite, and what its signals mean."""

import mujoco
import numpy as np
import pytest

from benchmarks.stock_world import StockWorld, largest_difference
from schemas.errors import ArtifactError
from stages.sim.config import WorldConfig
from stages.sim.controller import JointVelocityController
from stages.sim.gripper import closed_gripper_qpos, gripper_point_offset
from stages.sim.postures import HEIGHTS, sample_posture
from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT, Scene, build_scene
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
    world, stock = World(scene, task), StockWorld(scene.config, task)
    actions = np.random.default_rng(1).uniform(-1, 1, (200, world.action_dim)).astype(np.float32)
    assert largest_difference(world, stock, _initial(scene, task), actions) <= 1e-9
    state = world.state()
    moved = float(np.abs(state["qpos"] - scene.rest_qpos).max())
    assert moved > 0.05, "the arm must have moved for the comparison to mean anything"
    assert stock.environment._check_success() == state["lifted"]


@pytest.mark.parametrize("compiled", [True, False])
def test_torques_equal_robosuite_controller_bit_for_bit(scene: Scene, compiled: bool) -> None:
    """Thousands of substeps, of which many saturate, with a new goal every 25."""
    stock = StockWorld(scene.config, "reach")
    theirs, data = stock.environment.robots[0].part_controllers["right"], stock.data
    ours = JointVelocityController(scene.gains, scene.arm_qvel, scene.arm_actuators, compiled=compiled)
    rng, ctrl, saturated = np.random.default_rng(0), np.zeros(scene.model.nu), 0
    for substep in range(4000):
        if substep % 25 == 0:
            action = rng.uniform(-1.2, 1.2, 7)
            ours.set_goal(action)
            theirs.set_goal(action)
        data.qvel[scene.arm_qvel] = theirs.goal_vel + rng.normal(0, rng.choice([0.001, 0.01, 1.0]), 7)
        data.qfrc_bias[:] = rng.normal(0, 2, len(data.qfrc_bias))
        ours.control(data.qvel, data.qfrc_bias, ctrl)
        theirs.new_update = True
        assert np.array_equal(ctrl[scene.arm_actuators], theirs.run_controller())
        saturated += theirs.saturated
    assert 400 < saturated < 3600


def test_a_reset_controller_has_forgotten(scene: Scene) -> None:
    used, fresh = (JointVelocityController(scene.gains, scene.arm_qvel, scene.arm_actuators) for _ in range(2))
    used.set_goal(np.ones(7))
    torques = np.zeros((2, scene.model.nu))
    for _ in range(10):
        used.control(np.full(scene.model.nv, 0.1), np.zeros(scene.model.nv), torques[0])
    used.reset()
    for controller, ctrl in ((used, torques[0]), (fresh, torques[1])):
        controller.control(np.full(scene.model.nv, 0.2), np.ones(scene.model.nv), ctrl)
    assert np.array_equal(*torques) and torques.any()


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


def test_a_wider_reset_and_a_posture(scene: Scene) -> None:
    world, posture = World(scene, "lift"), np.full(7, 0.3)
    seeds = (np.random.default_rng(seed) for seed in range(100))
    states = [world.reset(sample_initial_state(scene, "lift", rng, 0.27, posture)) for rng in seeds]
    places = np.array([state["cube_position"][:2] for state in states])
    assert 0.25 < np.abs(places).max() <= 0.27
    assert np.mean([state["qpos"] for state in states], axis=0) == pytest.approx(scene.rest_qpos + 0.3, abs=0.01)


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


def test_a_gripper_goes_where_the_sign_of_its_command_says(scene: Scene) -> None:
    world = World(scene, "lift")
    world.reset(_initial(scene, "lift"))
    goals = [world.step(np.array([*np.zeros(7), command]))["gripper_goal"] for command in (1, 0.1, -0.3, -1, -1, 0)]
    assert goals == pytest.approx([0.2, 0.4, 0.2, 0.0, -0.2, -0.2])


def test_same_state_and_actions_give_the_same_bits(scene: Scene) -> None:
    initial, rng = _initial(scene, "lift"), np.random.default_rng(3)
    actions = rng.uniform(-1, 1, (10, 8)).astype(np.float32)
    ends = []
    for compiled in (True, True, False):
        world = World(scene, "lift", compiled=compiled)
        world.reset(initial)
        for action in actions:
            world.step(action)
        ends.append(world.integration_state())
    assert np.array_equal(ends[0], ends[1]) and np.array_equal(ends[0], ends[2])


def test_touch_is_judged_by_contact(scene: Scene) -> None:
    """Put the cube between the fingertips: they touch it; far away they do not."""
    world = World(scene, "reach")
    initial = _initial(scene, "reach")
    eef = world.reset(initial)["eef"].copy()
    assert not world.state()["touched"]
    data = mujoco.MjData(scene.model)
    unpack_state(scene.model, data, initial)
    data.qpos[scene.cube_qpos : scene.cube_qpos + 3] = eef
    touching = pack_state(scene.model, data)
    assert world.reset(touching)["touched"]
    by_distance_alone = World(build_scene(WorldConfig(touch="none")), "reach")
    assert not by_distance_alone.reset(touching)["touched"]


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


def test_an_action_that_is_no_number_says_so(scene: Scene) -> None:
    """MuJoCo sets the control to zero by itself, and the arm would go on as if that had been asked for."""
    world = World(scene, "reach")
    world.reset(_initial(scene, "reach"))
    assert world.step(np.full(7, np.nan))["unstable"]


def test_a_state_of_another_scene_is_refused(scene: Scene) -> None:
    with pytest.raises(ArtifactError, match="another robot"):
        World(scene, "reach").reset(np.zeros(5))


@pytest.mark.parametrize("robot", ["Sawyer", "IIWA", "Kinova3"])
def test_other_arms_reach_and_close(robot: str) -> None:
    """Any 7-DoF robosuite arm by name, against stock robosuite for a second."""
    scene = build_scene(WorldConfig(robot=robot))
    world, stock = World(scene, "lift"), StockWorld(scene.config, "lift")
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 8))
    assert largest_difference(world, stock, _initial(scene, "lift"), actions) <= 1e-9
    state = world.state()
    assert state.dtype == STATE_DTYPE and not state["unstable"]
    posture = sample_posture(scene, np.random.default_rng(0))
    leaning = world.reset(sample_initial_state(scene, "lift", np.random.default_rng(0), posture=posture))
    assert HEIGHTS[0] < leaning["eef"][2] - TABLE_HEIGHT < HEIGHTS[1]
    assert 0 < gripper_point_offset(scene, "reach") < 0.1
