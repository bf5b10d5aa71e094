"""A trained policy from its run's artifact, for collecting data with it."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from pydantic import BaseModel
from safetensors import SafetensorError
from safetensors.torch import load_file

from schemas.errors import ArtifactError
from stages.policy.config import Proprioception
from stages.policy.observation import observation_dim, observe
from stages.sim.config import TaskName, action_dim


class _Description(BaseModel):
    """What policy.json says of the network beside it; the rest of it is the run's summary."""

    hidden: tuple[int, ...]
    proprioception: Proprioception
    task: TaskName

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of the actor's tensors by name, first layer to last."""
        sizes = (observation_dim(self.proprioception), *self.hidden, action_dim(self.task))
        found: dict[str, tuple[int, ...]] = {}
        for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
            found |= {f"actor.{layer}.weight": (inputs, outputs), f"actor.{layer}.bias": (outputs,)}
        return found


class PolicyActor:
    """Acts on the true state: collection knows the cube, and the estimator that will see the frames is yet to come."""

    def __init__(
        self, layers: list[tuple[torch.Tensor, torch.Tensor]], proprioception: Proprioception, task: str
    ) -> None:
        self._layers, self._proprioception, self.task = layers, proprioception, task

    @torch.no_grad()
    def act(self, state: np.void, task: str) -> np.ndarray:
        """Action (7,) or (8,) for one state of STATE_DTYPE.

        Raises:
            ArtifactError: the policy was trained for another task.
        """
        if task != self.task:
            raise ArtifactError(f"the policy was trained to {self.task}, not to {task}: set collect.tasks accordingly")
        states = np.asarray(state)[None]
        hidden = torch.from_numpy(observe(states, states["cube_position"].astype(np.float32), self._proprioception))
        for index, (weight, bias) in enumerate(self._layers):
            hidden = hidden @ weight + bias
            hidden = hidden.relu() if index + 1 < len(self._layers) else hidden.tanh()
        return hidden[0].numpy()


def load_actor(run: Path) -> PolicyActor:
    """The policy of a finished run.

    Raises:
        ArtifactError: there is none, or it is damaged.
    """
    directory = run / "checkpoints"
    try:
        description = _Description.model_validate_json((directory / "policy.json").read_bytes())
        file = directory / "policy.safetensors"
        tensors = load_file(file)
        layers = [_checked(tensors[name], shape, f"{file}: {name}") for name, shape in description.shapes().items()]
        pairs = list(zip(layers[::2], layers[1::2], strict=True))
        return PolicyActor(pairs, description.proprioception, description.task)
    except (OSError, ValueError, KeyError, SafetensorError) as error:
        raise ArtifactError(f"{run} holds no policy ({error}); finish it with train-policy --resume") from error


def _checked(values: torch.Tensor, shape: tuple[int, ...], what: str) -> torch.Tensor:
    if values.dtype != torch.float32 or values.shape != shape:
        found = f"{values.dtype} {tuple(values.shape)}"
        raise ArtifactError(f"{what} is {found}, policy.json asks for {torch.float32} {shape}; train the run again")
    if not values.isfinite().all():
        raise ArtifactError(f"{what} is not finite, it would act on no number; train the run again")
    return values
