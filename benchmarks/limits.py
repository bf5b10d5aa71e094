"""The parts of a training step, each measured alone on one core, and what the machine could do at best."""

from dataclasses import dataclass

import numpy as np
import torch

from benchmarks import roofline
from benchmarks.measure import milliseconds
from benchmarks.stock import ACTION_DIM
from benchmarks.training import IMAGE_SIZE
from stages.device import arithmetic
from stages.perception.frozen import FrozenResNet34
from stages.perception.quantised import is_supported, measure_ranges
from stages.perception.resnet34 import ResNet34
from stages.policy.config import TD3Config
from stages.policy.observation import observation_dim
from stages.policy.td3 import TD3, Batch
from stages.sim.camera import nominal_pose
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.processes import available_cores
from stages.sim.renderer import Renderer
from stages.sim.scene import build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World


@dataclass(frozen=True)
class Limits:
    """Milliseconds on one core per environment step: as we do it, and at the machine's bare speed."""

    parts: dict[str, tuple[float, float | None]]
    bare_speeds: dict[str, float]
    cores: int


def training_limits(runs: int) -> Limits:
    """Measure the parts of one environment step of one of `runs` runs in lockstep, with the default settings."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        dtype = arithmetic("bfloat16", torch.device("cpu"))
        gflops = roofline.matrix_gflops(dtype)
        gops = roofline.integer_gops() if is_supported() else gflops  # of the estimator's blocks
        parts = _simulation() | _networks(runs, dtype, gflops, gops)
    finally:
        torch.set_num_threads(threads)
    speeds = {
        f"matrix products, {str(dtype)[6:]}, one thread [GFLOP/s]": gflops,
        "the estimator's, one thread [GOP/s]": gops,
    }
    return Limits(parts, speeds, available_cores())


def _simulation() -> dict[str, tuple[float, float | None]]:
    scene, camera = build_scene(WorldConfig()), CameraConfig(image_size=IMAGE_SIZE)
    world = World(scene, "reach")
    world.reset(sample_initial_state(scene, "reach", np.random.default_rng(0)))
    qpos, pose, still = world.qpos_full(), nominal_pose(camera), np.zeros(ACTION_DIM)
    bare = roofline.mj_step_ms(scene, qpos)
    step = milliseconds(lambda: world.step(still), repetitions=100)
    with Renderer(scene, camera.image_size, camera.fovy) as renderer:
        frame = milliseconds(lambda: renderer.render(qpos, pose), repetitions=100)
        raster = roofline.raster_ms(renderer)
    return {"physics": (bare, bare), "control": (step - bare, None), "render": (frame, raster)}


def _networks(runs: int, dtype: torch.dtype, gflops: float, gops: float) -> dict[str, tuple[float, float | None]]:
    config, observations = TD3Config(), observation_dim("forward_kinematics")
    td3 = TD3(config, observations, ACTION_DIM, list(range(runs)))
    batch = Batch(*(torch.zeros(runs, config.batch_size, *shape) for shape in _shapes(observations)))
    noise = torch.zeros(runs, config.batch_size, ACTION_DIM)
    pair = milliseconds(lambda: (td3.update(batch, noise), td3.update(batch, noise)))  # of which one moves the actor
    images = torch.randn(runs, 3, IMAGE_SIZE, IMAGE_SIZE)
    resnet34 = ResNet34().eval()
    network = FrozenResNet34(resnet34, dtype, torch.device("cpu"), measure_ranges(resnet34, images))
    inference = milliseconds(lambda: network(images)) / runs
    shape = observations, ACTION_DIM, config.hidden, config.batch_size, config.policy_delay
    return {
        "inference": (inference, roofline.resnet34_gflop(IMAGE_SIZE) / gops * 1e3),
        "update": (pair / 2 / runs, roofline.td3_gflop(*shape) / gflops * 1e3),
    }


def _shapes(observations: int) -> list[tuple[int, ...]]:
    return [(observations,), (ACTION_DIM,), (), (observations,), ()]
