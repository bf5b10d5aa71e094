"""A trained ResNet34 as it runs in the control loop: norms folded, weights packed, additions and ReLUs fused.

Measured in milliseconds at 64 × 64 pixels, bfloat16, one thread, on a 2-core AVX-512 CPU:

    batch                                          1     2     4    12
    torch's modules, folded, channels last      11.5  14.6  19.5  39.0
    this                                         5.7   8.5  13.5  33.6

The difference is oneDNN's reordering of 43 MB of weights, which torch otherwise repeats in every call.
"""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, max_pool2d
from torch.nn.utils.fusion import fuse_conv_bn_eval

from stages.device import has_onednn
from stages.perception.quantised import QuantisedBlocks, Ranges, is_supported
from stages.perception.resnet34 import BasicBlock, ResNet34, residual_blocks


@dataclass(frozen=True)
class _Convolution:
    """Convolution + bias [+ shortcut] [+ ReLU]."""

    weight: Tensor
    bias: Tensor
    stride: tuple[int, ...]
    padding: tuple[int, ...]
    packed: bool  # for oneDNN

    def __call__(self, x: Tensor, shortcut: Tensor | None = None, relu: bool = True) -> Tensor:
        if self.packed:
            return self._onednn(x, shortcut, relu)
        x = conv2d(x, self.weight, self.bias, self.stride, self.padding)
        x = x if shortcut is None else x.add_(shortcut)
        return torch.relu_(x) if relu else x

    def _onednn(self, x: Tensor, shortcut: Tensor | None, relu: bool) -> Tensor:
        # The operators that torch.compile emits for CPUs; called directly they need no compiler on the user's machine.
        operator = torch.ops.mkldnn._convolution_pointwise
        convolution = (self.weight, self.bias, self.padding, self.stride, (1, 1), 1)
        activation = "relu" if relu else "none"
        if shortcut is None:
            return operator(x, *convolution, activation, [], "")
        return operator.binary(x, shortcut, *convolution, "add", 1.0, activation, [], "")


@dataclass(frozen=True)
class _Block:
    first: _Convolution
    second: _Convolution
    downsample: _Convolution | None

    def __call__(self, x: Tensor) -> Tensor:
        shortcut = x if self.downsample is None else self.downsample(x, relu=False)
        return self.second(self.first(x), shortcut)


class FrozenResNet34:
    """Normalised images (n, 3, h, w) → outputs (n, 3) float32; a copy that no longer trains.

    On a CPU an image's output is the same to the bit whatever else is in the batch, and however many threads there are.
    """

    def __init__(
        self, network: ResNet34, dtype: torch.dtype, device: torch.device, ranges: Ranges | None = None
    ) -> None:
        """With `ranges` of its activations the blocks run in integers, where the CPU is made for it."""
        self._dtype, self._device = dtype, device
        network = copy.deepcopy(network).float().cpu().eval()
        self._stem = self._freeze(network.conv1, network.bn1)
        self._quantised = None
        if ranges is not None and device.type == "cpu" and is_supported():
            self._quantised = QuantisedBlocks(network, ranges)
        self._blocks = [] if self._quantised else [self._freeze_block(block) for block in residual_blocks(network)]
        self._fc_weight = network.fc.weight.detach().to(device)  # (3, 512)
        self._fc_bias = network.fc.bias.detach().to(device)  # (3,)

    def _freeze_block(self, block: BasicBlock) -> _Block:
        first, second = self._freeze(block.conv1, block.bn1), self._freeze(block.conv2, block.bn2)
        if block.downsample is None:
            return _Block(first, second, None)
        convolution, norm = cast(tuple[nn.Conv2d, nn.BatchNorm2d], tuple(block.downsample))
        return _Block(first, second, self._freeze(convolution, norm))

    def _freeze(self, convolution: nn.Conv2d, norm: nn.BatchNorm2d) -> _Convolution:
        folded = fuse_conv_bn_eval(convolution, norm)
        assert folded.bias is not None  # it holds the norm's shift
        weight = folded.weight.detach().to(self._device, self._dtype, memory_format=torch.channels_last)
        bias = folded.bias.detach().to(self._device, self._dtype)
        stride, padding = convolution.stride, (convolution.kernel_size[0] // 2,) * 2
        packed = has_onednn(self._device)
        if packed:
            weight = torch.ops.mkldnn._reorder_convolution_weight(weight, padding, stride, (1, 1), 1, None)
        return _Convolution(weight, bias, stride, padding, packed)

    @torch.inference_mode()
    def __call__(self, images: Tensor) -> Tensor:
        with _threads_for(len(images)):
            return self._outputs(images)

    def _outputs(self, images: Tensor) -> Tensor:
        x = images.to(self._device, self._dtype, memory_format=torch.channels_last)
        x = max_pool2d(self._stem(x), 3, 2, padding=1)
        if self._quantised:
            x = self._quantised(x)
        for block in self._blocks:
            x = block(x)
        features = x.float().mean(dim=(2, 3))  # (n, 512)
        # A matrix product would round differently for one image and for many; this sums every row by itself.
        return (features[:, None] * self._fc_weight).sum(dim=2) + self._fc_bias


@contextmanager
def _threads_for(images: int) -> Iterator[None]:
    """One thread for one image: oneDNN would share it out, and on CPUs with AMX round 1 in 200 another way; it is no
    faster (4.0 against 4.3 ms). Two images and more come out the same for any number of threads.
    """
    threads = torch.get_num_threads()
    if images == 1:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
