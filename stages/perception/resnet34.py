"""ResNet34 (He et al. 2016, "Deep Residual Learning", table 1) with torchvision's state-dict keys.

torchvision has no CPU build beside the torch this project pins; its keys are kept so that public ImageNet weights load.
The stem is the standard one (7×7 stride 2, then max-pool stride 2), as "ResNet34" in the paper says: at 64 × 64 pixels
the last stage sees 2 × 2 cells, at 128 × 128 it sees 4 × 4.
"""

from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from schemas.errors import ArtifactError

STAGES = ((3, 64), (4, 128), (6, 256), (3, 512))
"""(basic blocks, channels) of layer1 … layer4."""


class BasicBlock(nn.Module):
    """Two 3×3 convolutions and a shortcut; the first block of a stage may halve the resolution."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample: nn.Sequential | None = None
        if stride != 1 or inputs != outputs:
            shortcut = nn.Conv2d(inputs, outputs, 1, stride, bias=False)
            self.downsample = nn.Sequential(shortcut, nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:  # (n, inputs, h, w) → (n, outputs, h / stride, w / stride)
        shortcut = x if self.downsample is None else self.downsample(x)
        x = torch.relu_(self.bn1(self.conv1(x)))
        return torch.relu_(self.bn2(self.conv2(x)).add_(shortcut))


def _stage(blocks: int, inputs: int, outputs: int, stride: int) -> nn.Sequential:
    rest = (BasicBlock(outputs, outputs, 1) for _ in range(blocks - 1))
    return nn.Sequential(BasicBlock(inputs, outputs, stride), *rest)


class ResNet34(nn.Module):
    """Image (n, 3, h, w) → (n, outputs)."""

    def __init__(self, outputs: int = 3) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.maxpool = nn.MaxPool2d(3, 2, padding=1)
        inputs = 64
        for number, (blocks, channels) in enumerate(STAGES, start=1):
            self.add_module(f"layer{number}", _stage(blocks, inputs, channels, stride=1 if number == 1 else 2))
            inputs = channels
        self.fc = nn.Linear(inputs, outputs)
        self._initialise()

    def _initialise(self) -> None:
        """He et al. 2015: convolutions normal with variance 2 / (k² · outputs)."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> Tensor:
        x = self.maxpool(torch.relu_(self.bn1(self.conv1(x))))
        for number in range(1, len(STAGES) + 1):
            x = getattr(self, f"layer{number}")(x)
        return self.fc(x.mean(dim=(2, 3)))


def residual_blocks(network: ResNet34) -> list[BasicBlock]:
    """All blocks, first to last."""
    return [block for stage in range(1, len(STAGES) + 1) for block in getattr(network, f"layer{stage}")]


def load_weights(network: ResNet34, file: Path) -> None:
    """Start `network` from public ImageNet weights (safetensors, or a torch file of tensors only).

    The 1000-class `fc` is dropped: the network keeps its own. Raises ArtifactError when anything else does not match.
    """
    given = {key: value for key, value in _read_tensors(file).items() if not key.startswith("fc.")}
    expected = {key: value for key, value in network.state_dict().items() if not key.startswith("fc.")}
    # Files saved before torch 0.4.1 lack the counters of seen batches, which only a momentum of None would need.
    missing = sorted(key for key in expected.keys() - given.keys() if not key.endswith("num_batches_tracked"))
    unknown = sorted(given.keys() - expected.keys())
    shapes = sorted(key for key in expected.keys() & given.keys() if expected[key].shape != given[key].shape)
    problems = {"missing": missing, "unknown": unknown, "of another shape": shapes}
    found = [f"{what}: {_some(keys)}" for what, keys in problems.items() if keys]
    if found:
        raise ArtifactError(f"{file}: not the weights of a ResNet34 with torchvision's keys; {'; '.join(found)}")
    network.load_state_dict(given, strict=False)


def _read_tensors(file: Path) -> dict[str, Tensor]:
    try:
        if file.suffix == ".safetensors":
            return load_file(file)
        tensors = torch.load(file, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise ArtifactError(f"{file}: no such file of weights") from error
    except Exception as error:  # on foreign bytes torch's restricted unpickler raises whatever its state leads to
        problem = f"cannot be read as weights ({type(error).__name__})"
        raise ArtifactError(f"{file}: {problem}; give a .safetensors file or a torch file of tensors") from error
    if not isinstance(tensors, dict) or not all(isinstance(value, Tensor) for value in tensors.values()):
        raise ArtifactError(f"{file}: holds no state dict (tensors by name)")
    return tensors


def _some(keys: list[str], limit: int = 5) -> str:
    more = f" and {len(keys) - limit} more" if len(keys) > limit else ""
    return ", ".join(keys[:limit]) + more
