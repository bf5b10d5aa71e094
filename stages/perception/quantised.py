"""The residual blocks of a ResNet34 in 8-bit integers, as they run in the control loop of CPUs that multiply them fast.

Weights are symmetric per output channel, activations unsigned with one step per tensor, measured on training frames;
products are summed in 32 bits (Jacob et al. 2018). Stem, pooling and the last layer are left as they are.

Milliseconds an image at 64 × 64 pixels, one thread, on an Intel Xeon with AVX-512 but neither VNNI nor bfloat16:

    batch            1     2     3     6    12
    float32       29.3  24.3  21.4  18.8  17.2
    this          22.9  13.3  11.5   8.7   7.9
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from stages.perception.resnet34 import BasicBlock, ResNet34, residual_blocks

Ranges = tuple[tuple[float, float], ...]
"""Lowest and highest value of each activation that becomes an integer, in the order of `measure_ranges`."""


def is_supported() -> bool:
    """Whether torch has the operators and this CPU the width: without AVX-512 nothing was measured."""
    operators = all(hasattr(torch.ops.onednn, name) for name in ("qconv_prepack", "qconv2d_pointwise"))
    return operators and torch.backends.mkldnn.is_available() and bool(torch.cpu.get_capabilities().get("avx512_f"))


def _largest_weight() -> int:
    """Of the integers: without VNNI two products are added in 16 bits, where 2 · 255 · 127 would be cut off."""
    return 127 if torch.cpu.get_capabilities().get("avx512_vnni") else 64


def activations(network: ResNet34) -> int:
    """How many ranges `measure_ranges` finds."""
    return 1 + sum(2 + (block.downsample is not None) for block in residual_blocks(network))


@torch.inference_mode()
def measure_ranges(network: ResNet34, images: Tensor) -> Ranges:
    """Ranges of the blocks' input, and of each block's first convolution, shortcut where it has one, and output.

    `images` (n, 3, h, w) are normalised; the network is in evaluation mode.
    """
    x = network.maxpool(torch.relu_(network.bn1(network.conv1(images))))
    ranges = [_range(x)]
    for block in residual_blocks(network):
        ranges.append(_range(torch.relu(block.bn1(block.conv1(x)))))
        if block.downsample is not None:
            ranges.append(_range(block.downsample(x)))
        x = block(x)
        ranges.append(_range(x))
    return tuple(ranges)


class QuantisedBlocks:
    """Output of the stem (n, 64, h, w) → features (n, 512, h', w') float32.

    An image's output is the same to the bit whatever else is in the batch.
    """

    def __init__(self, network: ResNet34, ranges: Ranges) -> None:
        scales = iter([_Scale.of(low, high) for low, high in ranges])
        self._input = scale = next(scales)
        self._blocks: list[_Block] = []
        for block in residual_blocks(network):
            self._blocks.append(_Block.of(block, scale, scales))
            scale = self._blocks[-1].output
        self._output = scale

    def __call__(self, x: Tensor) -> Tensor:
        quantised = self._input.quantise(x)
        for block in self._blocks:
            quantised = block(quantised)
        return self._output.real(quantised)


@dataclass(frozen=True)
class _Scale:
    """real = step · (integer − zero), integers 0 … 255."""

    step: float
    zero: int

    @staticmethod
    def of(low: float, high: float) -> "_Scale":
        low, high = min(low, 0.0), max(high, 0.0)  # zero must be exact: it pads the images
        step = max(high - low, 1e-6) / 255
        return _Scale(step, round(-low / step))

    def quantise(self, values: Tensor) -> Tensor:
        return (values.float() / self.step + self.zero).round_().clamp_(0, 255).to(torch.uint8)

    def real(self, integers: Tensor) -> Tensor:
        return (integers.float() - self.zero) * self.step


class _Convolution:
    """Convolution + bias [+ shortcut] [+ ReLU], from integers to integers."""

    def __init__(self, convolution: nn.Module, norm: nn.Module, source: _Scale, target: _Scale) -> None:
        assert isinstance(convolution, nn.Conv2d)
        assert isinstance(norm, nn.BatchNorm2d)
        folded = fuse_conv_bn_eval(convolution, norm)
        assert folded.bias is not None  # it holds the norm's shift
        weight = folded.weight.detach()
        steps = weight.abs().amax(dim=(1, 2, 3)).clamp(min=1e-12) / _largest_weight()  # (outputs,)
        integers = (weight / steps[:, None, None, None]).round().to(torch.int8)
        shape = convolution.stride, (convolution.kernel_size[0] // 2,) * 2, (1, 1), 1
        packed = torch.ops.onednn.qconv_prepack(integers, steps, source.step, source.zero, *shape)
        self._source = source.step, source.zero, packed, steps, torch.zeros(len(weight), dtype=torch.int64)
        self._rest: tuple[Any, ...] = folded.bias.detach(), *shape, target.step, target.zero, torch.uint8

    def __call__(self, x: Tensor, relu: bool = True) -> Tensor:
        activation = "relu" if relu else "none"
        return torch.ops.onednn.qconv2d_pointwise(x, *self._source, *self._rest, activation, [], "")

    def add_to(self, shortcut: Tensor, scale: _Scale, x: Tensor) -> Tensor:
        """relu(convolution + shortcut), written over `shortcut`, whose scale is given."""
        operator, accumulator = torch.ops.onednn.qconv2d_pointwise.binary, (scale.step, scale.zero)
        return operator(x, *self._source, shortcut, *self._rest, *accumulator, "sum", 1.0, "relu", [], "")


@dataclass(frozen=True)
class _Block:
    first: _Convolution
    second: _Convolution
    downsample: _Convolution | None
    shortcut: _Scale
    output: _Scale

    @staticmethod
    def of(block: BasicBlock, source: _Scale, scales: Iterator[_Scale]) -> "_Block":
        middle = next(scales)
        first = _Convolution(block.conv1, block.bn1, source, middle)
        downsample, shortcut = None, source
        if block.downsample is not None:
            shortcut = next(scales)
            convolution, norm = block.downsample
            downsample = _Convolution(convolution, norm, source, shortcut)
        output = next(scales)
        return _Block(first, _Convolution(block.conv2, block.bn2, middle, output), downsample, shortcut, output)

    def __call__(self, x: Tensor) -> Tensor:
        middle = self.first(x)
        shortcut = x if self.downsample is None else self.downsample(x, relu=False)
        return self.second.add_to(shortcut, self.shortcut, middle)


def _range(values: Tensor) -> tuple[float, float]:
    return float(values.min()), float(values.max())
