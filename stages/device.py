"""Where and in which arithmetic a network runs."""

import torch

from schemas.config import Precision
from schemas.errors import MachineError

_OPERATORS = ("_convolution_pointwise", "_reorder_convolution_weight", "_is_mkldnn_bf16_supported")
"""Not public API: where torch has them no more, estimators run through its ordinary modules."""


def torch_device(name: str) -> torch.device:
    """The device called `name` (cpu or cuda). Raises MachineError when it is not there."""
    if name == "cuda" and not torch.cuda.is_available():
        raise MachineError("device is cuda, but torch sees no CUDA GPU here; use device = 'cpu' or fix the driver")
    return torch.device(name)


def has_onednn(device: torch.device) -> bool:
    """Whether convolutions run through oneDNN, whose kernels fuse and keep packed weights."""
    if device.type != "cpu" or not torch.backends.mkldnn.is_available():
        return False
    return all(hasattr(torch.ops.mkldnn, name) for name in _OPERATORS)


def arithmetic(precision: Precision, device: torch.device) -> torch.dtype:
    """The type to compute in: float32 where a CPU does not multiply bfloat16 itself."""
    if precision == "float32" or (device.type == "cpu" and not _multiplies_bfloat16(device)):
        return torch.float32
    return torch.bfloat16


def _multiplies_bfloat16(device: torch.device) -> bool:
    """Whether this CPU has the instructions.

    oneDNN calls bfloat16 supported wherever there is AVX-512, and where there is no more it converts and computes in
    float32: TD3's update then takes 2.5 times as long as in float32, a ResNet34's training twice as long. Without
    AVX-512, and where torch has no oneDNN, loops take over that are slower still.
    """
    if not (has_onednn(device) and torch.ops.mkldnn._is_mkldnn_bf16_supported()):
        return False
    found = torch.cpu.get_capabilities()
    return found["architecture"] != "x86_64" or found["avx512_bf16"] or found["amx_bf16"]
