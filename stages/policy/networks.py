"""Multilayer perceptrons of many runs as one batched computation.

The parameters of a network are one flat row per run, (runs, parameters): a run's weights, its optimiser state, a soft
update and a checkpoint are then a row, and the forward pass of all runs is one batched matrix product per layer.
"""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

ALIGNMENT = 16  # float32 numbers, 64 bytes: a cache line, and the widest vector register


class StackedMLP:
    """ReLU layers of the given sizes; pure functions of flat parameters."""

    def __init__(self, sizes: tuple[int, ...]) -> None:
        self.sizes = sizes
        self.shapes = [shape for i, o in pairwise(sizes) for shape in ((i, o), (1, o))]
        self._sizes = [a * b for a, b in self.shapes]
        # Rows begin at equal alignments, or the same product rounds differently from run to run.
        self._padding = -sum(self._sizes) % ALIGNMENT
        self.parameters = sum(self._sizes) + self._padding

    def initial(self, rng: np.random.Generator) -> Tensor:
        """Parameters (parameters,) of one network, uniform in ±1/√inputs as torch.nn.Linear draws them."""
        draws = [rng.uniform(-(i**-0.5), i**-0.5, i * o + o) for i, o in pairwise(self.sizes)]
        return torch.from_numpy(np.concatenate([*draws, np.zeros(self._padding)]).astype(np.float32))

    def forward(self, flat: Tensor, inputs: Tensor) -> Tensor:
        """Networks (n, parameters) applied to inputs (n, batch, in) → (n, batch, out)."""
        *flats, _ = flat.split([*self._sizes, self._padding], dim=1)
        pieces = [piece.view(-1, *shape) for piece, shape in zip(flats, self.shapes, strict=True)]
        hidden = inputs
        for layer in range(0, len(pieces), 2):
            hidden = torch.baddbmm(pieces[layer + 1], hidden, pieces[layer])
            if layer + 2 < len(pieces):
                hidden = hidden.relu()
        return hidden

    def named(self, flat: Tensor) -> dict[str, Tensor]:
        """One network's parameters (parameters,) by layer: `0.weight` (in, out), `0.bias` (out,), …"""
        *pieces, _ = flat.split([*self._sizes, self._padding])
        names = [f"{layer}.{kind}" for layer in range(len(self.sizes) - 1) for kind in ("weight", "bias")]
        return {
            name: piece.view(shape if name.endswith("weight") else shape[1]).clone()
            for name, piece, shape in zip(names, pieces, self.shapes, strict=True)
        }


class StackedAdam:
    """Adam (Kingma & Ba 2015) on rows, each with its own step count, so that one run can pause or start afresh."""

    BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8

    def __init__(self, parameters: Tensor, learning_rate: float) -> None:
        self.parameters, self.learning_rate = parameters, learning_rate
        self.mean, self.square = torch.zeros_like(parameters), torch.zeros_like(parameters)
        self.steps = torch.zeros(len(parameters), 1, device=parameters.device)

    @torch.no_grad()
    def step(self, gradient: Tensor, active: Tensor) -> None:
        """One step for the rows where `active` (n, 1) is 1; the others stay exactly as they are."""
        self.steps += active
        self.mean += (gradient - self.mean) * (active * (1 - self.BETA1))
        self.square += (gradient.square() - self.square) * (active * (1 - self.BETA2))
        counts = self.steps.clamp(min=1)
        scale = active * self.learning_rate / (1 - self.BETA1**counts)
        denominator = (self.square / (1 - self.BETA2**counts)).sqrt_().add_(self.EPSILON)
        self.parameters -= scale * self.mean / denominator

    def forget(self, row: int) -> None:
        """Start the row's statistics afresh."""
        self.mean[row], self.square[row], self.steps[row] = 0, 0, 0
