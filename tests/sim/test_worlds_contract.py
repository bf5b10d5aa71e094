"""One contract, checked on the fake worlds and on the real pool, in this process and in workers."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from schemas.errors import MachineError
from stages.sim.camera import misaligned, nominal_pose
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.pool import View, WorldPool, Worlds
from tests.fake_worlds import FakeWorlds

CAMERA = CameraConfig(image_size=32)
ENTROPIES = [[0, 1, 0], [1, 1, 0], [0, 1, 0]]


def _pool(workers: int) -> WorldPool:
    nominal = nominal_pose(CAMERA)
    poses = (nominal, nominal, misaligned(nominal, "orbit", 10, np.array(CAMERA.target)))
    return WorldPool(WorldConfig(), "reach", 3, View(poses, CAMERA.image_size, CAMERA.fovy), workers)


MAKERS: dict[str, Callable[[], Worlds]] = {
    "fake": lambda: FakeWorlds(3),
    "in process": lambda: _pool(0),
    "two workers": lambda: _pool(2),
}


@pytest.fixture(params=list(MAKERS), scope="module")
def worlds(request: pytest.FixtureRequest) -> Iterator[Worlds]:
    made = MAKERS[request.param]()
    yield made
    made.close()


def _roll(worlds: Worlds, steps: int = 3) -> tuple[np.ndarray, np.ndarray | None, list[np.ndarray]]:
    worlds.reset(ENTROPIES)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        worlds.start_step(np.tile(rng.uniform(-1, 1, worlds.action_dim).astype(np.float32), (3, 1)))
        worlds.finish_step()
    frames = None if worlds.frames is None else worlds.frames.copy()
    return worlds.states.copy(), frames, worlds.packed_states()


def test_reset_follows_its_entropy_alone(worlds: Worlds) -> None:
    worlds.reset(ENTROPIES)
    cubes = worlds.states["cube_position"]
    assert np.array_equal(cubes[0], cubes[2]) and not np.array_equal(cubes[0], cubes[1])
    assert (worlds.states["time_ns"] == 0).all()


def test_stepping_is_deterministic_and_advances_50_ms(worlds: Worlds) -> None:
    first, second = _roll(worlds), _roll(worlds)
    assert np.array_equal(first[0], second[0]) and np.array_equal(first[1], second[1])
    assert all(np.array_equal(a, b) for a, b in zip(first[2], second[2], strict=True))
    assert (first[0]["time_ns"] == 150_000_000).all()


def test_the_gripper_closes_step_by_step(worlds: Worlds) -> None:
    """As robosuite's Panda: a command moves the gripper's goal by 0.2 of −1 open to 1 closed; in reach it closes."""
    worlds.reset(ENTROPIES)
    goals = [worlds.states["gripper_goal"].copy()]
    for _ in range(6):
        worlds.start_step(np.zeros((3, worlds.action_dim), np.float32))
        worlds.finish_step()
        goals.append(worlds.states["gripper_goal"].copy())
    expected = [0, 0.2, 0.4, 0.6, 0.8, 1, 1]
    np.testing.assert_allclose(goals, np.repeat(np.array(expected)[:, None], 3, axis=1), atol=1e-12)


def test_worlds_do_not_touch_each_other(worlds: Worlds) -> None:
    states, _, packed = _roll(worlds)
    assert np.array_equal(states[0]["eef"], states[2]["eef"]), "same entropy, same actions"
    assert not np.array_equal(states[0]["cube_position"], states[1]["cube_position"])
    assert np.array_equal(packed[0], packed[2])


def test_states_are_finite_and_frames_are_images(worlds: Worlds) -> None:
    states, frames, _ = _roll(worlds)
    assert all(np.isfinite(states[name]).all() for name in ("qpos", "qvel", "eef", "cube_position"))
    assert np.allclose(np.linalg.norm(states["cube_quaternion"], axis=1), 1)
    assert frames is not None and frames.dtype == np.uint8 and frames.shape == (3, 32, 32, 3)


def test_a_dropped_world_stands_still(worlds: Worlds) -> None:
    worlds.reset(ENTROPIES)
    worlds.drop(1)
    before = worlds.states[1].copy()
    worlds.start_step(np.ones((3, worlds.action_dim), np.float32))
    worlds.finish_step()
    assert worlds.states[1] == before and worlds.states[0]["time_ns"] == 50_000_000


def test_results_do_not_depend_on_the_number_of_workers() -> None:
    rolls = []
    for workers in (0, 2):
        pool = _pool(workers)
        rolls.append(_roll(pool, steps=5))
        pool.close()
    assert np.array_equal(rolls[0][0], rolls[1][0]) and np.array_equal(rolls[0][1], rolls[1][1])
    assert not np.array_equal(rolls[0][1][0], rolls[0][1][2]), "the third camera is misaligned"


def test_a_killed_worker_is_one_clear_error() -> None:
    pool = _pool(1)
    pool._hands[0]._process.kill()
    with pytest.raises(MachineError, match="worker died"):
        pool.reset(ENTROPIES)
    pool.close()
