"""The frozen network against the one it is made from; normalisation."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from stages import device as device_file
from stages.device import arithmetic
from stages.perception import frozen
from stages.perception.normalisation import Normalisation, measure
from stages.perception.resnet34 import ResNet34

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def images():
    return torch.from_numpy(np.random.default_rng(0).normal(size=(5, 3, 64, 64)).astype(np.float32))


@pytest.fixture(scope="module")
def network(images):
    """Random weights, and batch norms with the statistics of `images`, random gains and shifts."""
    with torch.random.fork_rng(), torch.no_grad():
        torch.manual_seed(0)
        network = ResNet34()
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.momentum = 1.0
                torch.nn.init.uniform_(module.weight, 0.5, 1.5)
                torch.nn.init.normal_(module.bias, 0, 0.2)
        network.train()(images)
        return network.eval()


@pytest.mark.parametrize("packed", [True, False])
def test_frozen_network_computes_the_same(network, images, monkeypatch, packed):
    if not packed:
        monkeypatch.setattr(frozen, "has_onednn", lambda device: False)
    with torch.inference_mode():
        expected = network(images)
    outputs = frozen.FrozenResNet34(network, torch.float32, CPU)(images)
    assert (outputs - expected).abs().max() < 1e-4 * expected.std(dim=0).max()


def test_one_image_is_one_threads_work(network, images, monkeypatch):
    """Shared out it may round another way, and a run alone would not log what it logs beside others."""
    ready, seen = frozen.FrozenResNet34(network, torch.float32, CPU), []
    outputs = ready._outputs
    monkeypatch.setattr(ready, "_outputs", lambda x: seen.append(torch.get_num_threads()) or outputs(x))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        found = ready(images[:1]), ready(images[:2])
        assert (seen, torch.get_num_threads()) == ([1, 2], 2)
        assert torch.equal(found[0], found[1][:1])
    finally:
        torch.set_num_threads(before)


def test_freezing_leaves_the_network_as_it_was(network, images):
    before = {key: value.clone() for key, value in network.state_dict().items()}
    frozen.FrozenResNet34(network, torch.bfloat16, CPU)
    assert all(torch.equal(value, before[key]) for key, value in network.state_dict().items())


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ({"architecture": "x86_64", "avx512_bf16": False, "amx_bf16": False}, torch.float32),
        ({"architecture": "x86_64", "avx512_bf16": True, "amx_bf16": False}, torch.bfloat16),
        ({"architecture": "x86_64", "avx512_bf16": False, "amx_bf16": True}, torch.bfloat16),
        ({"architecture": "arm64"}, torch.bfloat16),
    ],
)
def test_bfloat16_is_for_cpus_that_multiply_it(monkeypatch, capabilities, expected):
    """oneDNN calls it supported wherever there is AVX-512, where it is slower than float32."""
    monkeypatch.setattr(device_file, "has_onednn", lambda device: True)
    monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: True, raising=False)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities)
    assert arithmetic("bfloat16", CPU) is expected


def test_cpus_without_bfloat16_compute_in_float32(monkeypatch):
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: False)
    assert arithmetic("bfloat16", CPU) is torch.float32
    assert arithmetic("bfloat16", torch.device("cuda")) is torch.bfloat16
    assert arithmetic("float32", torch.device("cuda")) is torch.float32


COORDINATES = st.floats(-2, 2, width=32)
NORMALISATION = Normalisation(
    pixel_mean=(0, 100, 50), pixel_std=(1, 50, 10), target_mean=(0.1, -0.2, 0.8), target_scale=0.08
)


@given(st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=1, max_size=5))
def test_positions_undo_targets(points):
    positions = np.array(points)
    outputs = torch.from_numpy(NORMALISATION.targets(positions))
    assert NORMALISATION.positions(outputs) == pytest.approx(positions, abs=1e-6)


def test_pixels_by_hand():
    image = torch.tensor([[[[7, 150, 40], [0, 0, 0]]]], dtype=torch.uint8)  # (1, 1, 2, 3)
    normalised = NORMALISATION.images(image)
    assert normalised.shape == (1, 3, 1, 2)
    assert normalised[0, :, 0, 0].tolist() == [7.0, 1.0, -1.0]
    assert normalised[0, :, 0, 1].tolist() == [0.0, -2.0, -5.0]


def test_squared_error_of_targets_is_that_of_metres_up_to_the_scale():
    rng = np.random.default_rng(0)
    positions = rng.normal([0, 0, 0.8], [0.1, 0.05, 0.01], (1000, 3))
    normalisation = measure(np.zeros((1000, 2, 2, 3), np.uint8), positions, np.arange(1000))
    targets = normalisation.targets(positions)
    assert normalisation.target_scale**2 == pytest.approx(positions.var(axis=0).mean())
    squared = ((targets[:-1] - targets[1:]) ** 2).sum(axis=1) * normalisation.target_scale**2
    assert squared == pytest.approx(((positions[:-1] - positions[1:]) ** 2).sum(axis=1), rel=1e-3, abs=1e-8)


def test_statistics_by_hand():
    """Rows 0 and 2 are the training split; row 1 must not count."""
    images = np.zeros((3, 1, 1, 3), np.uint8)
    images[1], images[2] = (200, 200, 200), (10, 20, 255)
    positions = np.array([[0.0, 0.0, 0.8], [9.0, 9.0, 9.0], [0.2, 0.0, 0.8]])
    normalisation = measure(images, positions, np.array([0, 2]))
    assert normalisation.pixel_mean == pytest.approx((5, 10, 127.5))
    assert normalisation.pixel_std == pytest.approx((5, 10, 127.5))
    assert normalisation.target_mean == pytest.approx((0.1, 0.0, 0.8))
    assert normalisation.target_scale == pytest.approx(np.sqrt(0.01 / 3))


def test_data_without_variation_are_not_divided_by_zero():
    normalisation = measure(np.zeros((3, 2, 2, 3), np.uint8), np.zeros((3, 3)), np.arange(3))
    assert normalisation.pixel_std == (1.0, 1.0, 1.0)
    assert normalisation.target_scale == 1e-3
