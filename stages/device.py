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
    """The type to compute in: float32 where a CPU's oneDNN knows no bfloat16 (torch would fall back to slow loops)."""
    if precision == "float32":
        return torch.float32
    if device.type == "cpu" and not (has_onednn(device) and torch.ops.mkldnn._is_mkldnn_bf16_supported()):
        return torch.float32
    return torch.bfloat16
