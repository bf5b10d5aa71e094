"""Multilayer perceptrons of many runs as one batched computation.

The parameters of a network are one flat row per run, (runs, parameters): a run's weights, its optimiser state, a soft
update and a checkpoint are then a row, and the forward pass of all runs is one batched matrix product per layer.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor
from torch.optim.adam import adam

Layers = list[Tensor]
"""Weight and bias of every layer in turn, first to last."""

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

    def layers(self, flat: Tensor, dtype: torch.dtype = torch.float32) -> Layers:
        """Weights (n, in, out) and biases (n, 1, out) of networks (n, parameters) in `dtype`, a value head in float32.

        A value in bfloat16 has but three digits, too few for the difference of two.
        """
        pieces = self._split(flat)
        low = len(pieces) - 2 if self.sizes[-1] == 1 else len(pieces)
        return [piece.to(dtype) for piece in pieces[:low]] + pieces[low:]

    def forward(self, layers: Layers, inputs: Tensor) -> Tensor:
        """Networks applied to inputs (n, batch, in) → (n, batch, out) float32."""
        *hidden_layers, weight, bias = layers
        hidden = inputs.to(layers[0].dtype)
        for hidden_weight, hidden_bias in zip(hidden_layers[::2], hidden_layers[1::2], strict=True):
            hidden = torch.baddbmm(hidden_bias, hidden, hidden_weight).relu_()
        if self.sizes[-1] == 1:
            return cast(Tensor, _ValueHead.apply(hidden, weight)) + bias
        return torch.baddbmm(bias, hidden, weight).float()

    def flatten(self, layers: Layers, flat: Tensor) -> None:
        """The inverse of `layers`: into rows (n, parameters) float32, their padding as it is."""
        for piece, layer in zip(self._split(flat), layers, strict=True):
            piece.copy_(layer)

    def _split(self, flat: Tensor) -> Layers:
        """Views of every layer's weight and bias."""
        *pieces, _ = flat.split([*self._sizes, self._padding], dim=1)
        return [piece.view(-1, *shape) for piece, shape in zip(pieces, self.shapes, strict=True)]

    def named(self, flat: Tensor) -> dict[str, Tensor]:
        """One network's parameters (parameters,) by layer: `0.weight` (in, out), `0.bias` (out,), …"""
        *pieces, _ = flat.split([*self._sizes, self._padding])
        names = [f"{layer}.{kind}" for layer in range(len(self.sizes) - 1) for kind in ("weight", "bias")]
        return {
            name: piece.view(shape if name.endswith("weight") else shape[1]).clone()
            for name, piece, shape in zip(names, pieces, self.shapes, strict=True)
        }


class _ValueHead(torch.autograd.Function):
    """Products (n, batch, 1) of hidden units (n, batch, h) with one column (n, h, 1) each, summed in float32.

    A matrix product would round the sum to the hidden units' type, or, in float32, take six times as long.
    """

    @staticmethod
    def forward(ctx: Any, hidden: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(hidden, weight)
        return (hidden.float() * weight.transpose(1, 2)).sum(dim=2, keepdim=True)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        hidden, weight = ctx.saved_tensors
        gradient = gradients[0].to(hidden.dtype)
        by_hidden = torch.bmm(gradient, weight.to(hidden.dtype).transpose(1, 2))
        return by_hidden, torch.bmm(hidden.transpose(1, 2), gradient).float()


class StackedAdam:
    """Adam (Kingma & Ba 2015) on rows, each with its own step count, so that one run can pause or start afresh."""

    def __init__(self, parameters: Tensor, learning_rate: float) -> None:
        self.parameters, self.learning_rate = parameters, learning_rate
        self.mean, self.square = torch.zeros_like(parameters), torch.zeros_like(parameters)
        self.steps = torch.zeros(len(parameters), 1, device=parameters.device)

    @torch.no_grad()
    def step(self, gradient: Tensor, rows: Sequence[int]) -> None:
        """One step of these rows; the others stay exactly as they are. `gradient` (rows, parameters) is of them."""
        adam(
            [self.parameters[row] for row in rows],
            list(gradient),
            [self.mean[row] for row in rows],
            [self.square[row] for row in rows],
            max_exp_avg_sqs=[],
            state_steps=[self.steps[row] for row in rows],
            fused=True,  # one pass over memory instead of ten
            amsgrad=False,
            maximize=False,
            beta1=0.9,
            beta2=0.999,
            eps=1e-8,
            weight_decay=0.0,
            lr=self.learning_rate,
        )

    def forget(self, row: int) -> None:
        """Start the row's statistics afresh."""
        self.mean[row], self.square[row], self.steps[row] = 0, 0, 0
