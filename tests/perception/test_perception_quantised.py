"""The residual blocks in 8-bit integers against the network they are made from."""

import numpy as np
import pytest
import torch

from stages.perception import frozen, quantised
from stages.perception.frozen import FrozenResNet34
from stages.perception.quantised import QuantisedBlocks, measure_ranges
from stages.perception.resnet34 import ResNet34

CPU = torch.device("cpu")
needs_integers = pytest.mark.skipif(not quantised.is_supported(), reason="this CPU is not made for 8-bit networks")


@pytest.fixture(scope="module")
def network() -> ResNet34:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return ResNet34().eval()


@pytest.fixture(scope="module")
def images() -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).normal(size=(5, 3, 64, 64)).astype(np.float32))


def test_ranges_by_hand(network: ResNet34, images: torch.Tensor) -> None:
    """One of the input, two of each of the 16 blocks, one of each of the 3 shortcuts; only shortcuts go below zero."""
    ranges = measure_ranges(network, images)
    assert len(ranges) == 1 + 2 * 16 + 3
    below = [index for index, (low, _) in enumerate(ranges) if low < 0]
    assert below == [1 + 2 * 3 + 1, 1 + 2 * 7 + 1 + 1, 1 + 2 * 13 + 2 + 1]
    pooled = network.maxpool(torch.relu(network.bn1(network.conv1(images))))
    assert ranges[0] == (float(pooled.min()), float(pooled.max()))


def test_integers_hold_zero_exactly_and_both_ends() -> None:
    scale = quantised._Scale.of(-1.0, 3.0)
    integers = scale.quantise(torch.tensor([-1.0, 0.0, 3.0, 9.0]))
    assert integers.tolist() == [0, 64, 255, 255]
    assert scale.real(integers)[1] == 0
    assert scale.real(integers).tolist() == pytest.approx([-1.0, 0.0, 3.0, 3.0], abs=scale.step / 2)


@needs_integers
def test_features_are_those_of_the_network_within_a_few_percent(network: ResNet34, images: torch.Tensor) -> None:
    with torch.inference_mode():
        x = network.maxpool(torch.relu(network.bn1(network.conv1(images))))
        expected = x
        for number in range(1, 5):
            expected = getattr(network, f"layer{number}")(expected)
        found = QuantisedBlocks(network, measure_ranges(network, images))(x.to(memory_format=torch.channels_last))
    assert float((found - expected).norm() / expected.norm()) < 0.05
    assert not torch.equal(found, expected)


@pytest.mark.parametrize(("vnni", "largest"), [(True, 127), (False, 64)])
def test_weights_have_8_bits_where_sums_have_32(vnni: bool, largest: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_f": True, "avx512_vnni": vnni})
    assert quantised._largest_weight() == largest
    assert vnni or 2 * 255 * largest < 2**15


@needs_integers
def test_sums_of_the_largest_weights_and_activations_are_not_cut_off() -> None:
    """64 channels of 3 × 3 ones times ones make 576; CPUs without VNNI add two products in 16 bits."""
    convolution, norm = torch.nn.Conv2d(64, 8, 3, padding=1, bias=False).eval(), torch.nn.BatchNorm2d(8, eps=0.0).eval()
    torch.nn.init.ones_(convolution.weight)
    source, target = quantised._Scale.of(0.0, 1.0), quantised._Scale.of(0.0, 600.0)
    ones = source.quantise(torch.ones(1, 64, 5, 5)).contiguous(memory_format=torch.channels_last)
    found = quantised._Convolution(convolution, norm, source, target)(ones)
    assert target.real(found)[0, :, 2, 2].tolist() == pytest.approx([576.0] * 8, abs=target.step)


@needs_integers
def test_an_image_has_the_same_output_in_any_company(network: ResNet34, images: torch.Tensor) -> None:
    integers = FrozenResNet34(network, torch.bfloat16, CPU, measure_ranges(network, images))
    together = integers(images)
    assert torch.equal(together, torch.cat([integers(image[None]) for image in images]))
    assert not torch.equal(together, FrozenResNet34(network, torch.bfloat16, CPU)(images)), "else nothing was tested"


def test_a_cpu_not_made_for_it_computes_as_before(
    network: ResNet34, images: torch.Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frozen, "is_supported", lambda: False)
    ranges = measure_ranges(network, images)
    found = FrozenResNet34(network, torch.float32, CPU, ranges)(images)
    assert torch.equal(found, FrozenResNet34(network, torch.float32, CPU)(images))
