"""Speeds that this machine reaches on bare work, from which the least time of a benchmark's work is computed."""

from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import torch

from benchmarks.measure import milliseconds
from stages.perception.resnet34 import ResNet34
from stages.sim.renderer import Renderer
from stages.sim.scene import Scene


def matrix_gflops(dtype: torch.dtype, size: int = 256, batch: int = 12) -> float:
    """Rate [GFLOP/s] of batched square matrix products on one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        a, b = torch.randn(batch, size, size).to(dtype), torch.randn(batch, size, size).to(dtype)
        return 2 * batch * size**3 / milliseconds(lambda: torch.bmm(a, b)) * 1e-6
    finally:
        torch.set_num_threads(threads)


def integer_gops(channels: int = 256, size: int = 16, batch: int = 6) -> float:
    """Rate [GOP/s] of 8-bit products on one thread, in the shape that the estimator's blocks have them in."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        ones, zeros = torch.ones(channels), torch.zeros(channels, dtype=torch.int64)
        shape = [1, 1], [1, 1], [1, 1], 1
        pixels = torch.zeros(batch, channels, size, size, dtype=torch.uint8).to(memory_format=torch.channels_last)
        weight = torch.ones(channels, channels, 3, 3, dtype=torch.int8)
        packed = torch.ops.onednn.qconv_prepack(weight, ones, 1.0, 0, *shape)
        into: tuple[Any, ...] = ones, *shape, 1.0, 0, torch.uint8, "none", [], ""
        convolve = torch.ops.onednn.qconv2d_pointwise
        work = 2 * batch * size**2 * 9 * channels**2
        return work / milliseconds(lambda: convolve(pixels, 1.0, 0, packed, ones, zeros, *into)) * 1e-6
    finally:
        torch.set_num_threads(threads)


def mj_step_ms(scene: Scene, qpos: np.ndarray) -> float:
    """Milliseconds of one control step's physics: nothing but mj_step, from generalised positions."""
    data = mujoco.MjData(scene.model)
    data.qpos[:] = qpos
    return milliseconds(lambda: mujoco.mj_step(scene.model, data, scene.substeps), repetitions=100)


def raster_ms(renderer: Renderer) -> float:
    """Milliseconds to rasterise what the renderer drew last and read it back: nothing but OpenGL."""
    canvas = renderer._canvas
    canvas._context.make_current()
    return milliseconds(lambda: canvas.draw(renderer._image, renderer._depth), repetitions=100)


def resnet34_gflop(image_size: int) -> float:
    """Floating point operations [GFLOP] of one ResNet34 prediction, counted by torch."""
    from torch.utils.flop_counter import FlopCounterMode

    with torch.device("meta"):
        network, image = ResNet34().eval(), torch.empty(1, 3, image_size, image_size)
    with FlopCounterMode(display=False) as counter:
        network(image)
    return counter.get_total_flops() * 1e-9


def td3_gflop(observation_dim: int, action_dim: int, hidden: tuple[int, ...], batch: int, delay: int) -> float:
    """Floating point operations [GFLOP] of one TD3 update of one run, matrix products alone, delayed actor averaged.

    Critic: target action 1 pass, target values 2, values 2, gradients of two critics (weights of every layer, inputs of
    all but the first). Actor, every `delay`-th time: action, value, gradient through the critic to the action and
    through the actor.
    """
    actor = _layers(observation_dim, hidden, action_dim)
    critic = _layers(observation_dim + action_dim, hidden, 1)
    critic_update = sum(actor) + 4 * sum(critic) + 2 * (sum(critic) + sum(critic[1:]))
    actor_update = 2 * sum(actor) + sum(actor[1:]) + 2 * sum(critic)
    return 2 * batch * (critic_update + actor_update / delay) * 1e-9


def _layers(inputs: int, hidden: tuple[int, ...], outputs: int) -> list[int]:
    sizes = (inputs, *hidden, outputs)
    return [a * b for a, b in pairwise(sizes)]
