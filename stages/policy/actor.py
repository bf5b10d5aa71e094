"""A trained policy from its run's artifact, for collecting data with it."""

from pathlib import Path
from typing import Literal

import numpy as np
import torch
from pydantic import BaseModel
from safetensors import SafetensorError
from safetensors.torch import load_file

from schemas.errors import ArtifactError
from stages.policy.observation import observe
from stages.sim.config import TaskName


class _Description(BaseModel):
    """What policy.json says of the network beside it; the rest of it is the run's summary."""

    hidden: tuple[int, ...]
    proprioception: Literal["forward_kinematics", "joints"]
    task: TaskName


class PolicyActor:
    """Acts on the true state: collection knows the cube, and the estimator that will see the frames is yet to come."""

    def __init__(self, layers: list[tuple[torch.Tensor, torch.Tensor]], proprioception: str, task: str) -> None:
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
        tensors = load_file(directory / "policy.safetensors")
        count = len(description.hidden) + 1
        layers = [(tensors[f"actor.{i}.weight"], tensors[f"actor.{i}.bias"]) for i in range(count)]
        return PolicyActor(layers, description.proprioception, description.task)
    except (OSError, ValueError, KeyError, SafetensorError) as error:
        raise ArtifactError(f"{run} holds no policy ({error}); finish it with train-policy --resume") from error
