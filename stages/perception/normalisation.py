"""From pixels and metres to what the network sees, and back. Saved with the estimator, nowhere else."""

from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from schemas.config import Config

Triple = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]

_PIXEL_SAMPLE = 512
"""Training frames that the pixel statistics are taken from, evenly spaced: they are one scene, so few suffice."""
_SMALLEST_SCALE = 1e-3
"""[m] Targets that do not vary must not be divided by zero."""


class Normalisation(Config):
    """Pixels per channel; positions with one scale for all axes.

    One common scale keeps the squared error summed over axes that of metres (paper, equation 2) up to the constant
    factor `target_scale²`, while the network regresses outputs of order one, which trains far better than centimetres.
    A scale per axis would weigh the height, which varies least, as much as all the rest.
    """

    pixel_mean: Triple  # RGB, 0 … 255
    pixel_std: tuple[Positive, Positive, Positive]
    target_mean: Triple  # [m]
    target_scale: Positive  # [m]

    def images(self, images: Tensor) -> Tensor:
        """uint8 (n, h, w, 3) → float32 (n, 3, h, w), channels last in memory."""
        mean = torch.tensor(self.pixel_mean, device=images.device)
        std = torch.tensor(self.pixel_std, device=images.device)
        return ((images - mean) / std).permute(0, 3, 1, 2)

    def targets(self, positions: np.ndarray) -> np.ndarray:
        """Positions (n, 3) [m] → network outputs (n, 3) float32."""
        return ((positions - np.array(self.target_mean)) / self.target_scale).astype(np.float32)

    def positions(self, outputs: Tensor) -> np.ndarray:
        """Network outputs (n, 3) → positions (n, 3) float32 [m]."""
        metres = outputs.double().cpu().numpy() * self.target_scale + np.array(self.target_mean)
        return metres.astype(np.float32)


def measure(images: np.ndarray, positions: np.ndarray, rows: np.ndarray) -> Normalisation:
    """Statistics of the training split `rows` of images (n, h, w, 3) uint8 and positions (n, 3) [m]."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, _PIXEL_SAMPLE).astype(int))
    pixels = images[rows[chosen]].reshape(-1, 3)
    positions = positions[rows]
    std = np.maximum(pixels.std(axis=0, dtype=np.float64), 1.0)
    scale = np.sqrt(positions.var(axis=0).mean())
    return Normalisation(
        pixel_mean=tuple(pixels.mean(axis=0, dtype=np.float64).tolist()),
        pixel_std=tuple(std.tolist()),
        target_mean=tuple(positions.mean(axis=0).tolist()),
        target_scale=max(float(scale), _SMALLEST_SCALE),
    )
