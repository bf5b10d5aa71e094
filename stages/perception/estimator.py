"""The artifact of perception: image → position of the cube, rebuilt from its own directory alone (SPEC §4)."""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load, load_file, save
from torch import Tensor

from schemas.config import Config, Precision
from schemas.errors import ArtifactError
from schemas.files import write_bytes
from schemas.tables import SCHEMA_VERSION
from stages.device import arithmetic, torch_device
from stages.perception.frozen import FrozenResNet34
from stages.perception.normalisation import Normalisation, Triple
from stages.perception.quantised import Ranges, activations
from stages.perception.resnet34 import ResNet34

WEIGHTS_FILE = "estimator.safetensors"
CARD_FILE = "estimator.json"


class EstimatorCard(Config):
    """estimator.json: what the weights alone do not say."""

    schema_version: Annotated[int, Field(ge=1)] = SCHEMA_VERSION
    estimator: str
    dataset: str
    architecture: Literal["resnet34"] = "resnet34"
    image_size: Annotated[int, Field(ge=1, le=1024)]  # pixels, square
    precision: Precision
    normalisation: Normalisation
    camera: dict[str, Any]
    """Nominal camera the frames were taken around: the dataset's CameraConfig (world frame [m], fovy [degrees])."""
    cube_min: Triple
    cube_max: Triple
    """Corners [m] of the training positions, world frame; beyond them the estimator extrapolates."""
    best_epoch: int
    """Epoch of the kept weights: the one of lowest validation error."""
    ranges: Ranges | None = None
    """Ranges of the activations, by which CPUs that can run the network in 8-bit integers; None: none should."""
    weights_sha256: str | None = None
    """Hash of the weights, for training that goes on before a manifest vouches for them; None: of an older version."""


def save_estimator(directory: Path, card: EstimatorCard, weights: dict[str, Tensor]) -> None:
    """Write both files; the card last, so that it never describes weights that are not there."""
    data = save({key: value.cpu().contiguous() for key, value in weights.items()})
    write_bytes(data, directory / WEIGHTS_FILE)
    sealed = card.model_copy(update={"weights_sha256": hashlib.sha256(data).hexdigest()})
    write_bytes((sealed.model_dump_json(indent=2) + "\n").encode(), directory / CARD_FILE)


def saved_weights(directory: Path) -> tuple[EstimatorCard, dict[str, Tensor]] | None:
    """What `save_estimator` wrote, if it did and both files are whole."""
    try:
        card, data = _read_card(directory / CARD_FILE), (directory / WEIGHTS_FILE).read_bytes()
    except (ArtifactError, OSError):
        return None
    return (card, load(data)) if card.weights_sha256 == hashlib.sha256(data).hexdigest() else None


class Estimator:
    """Positions from images; see `load` and `predict`."""

    def __init__(self, card: EstimatorCard, network: ResNet34, device: torch.device) -> None:
        self.card = card
        self.camera: dict[str, Any] = card.camera
        self.image_size: int = card.image_size
        self._device = device
        self._network = FrozenResNet34(network, arithmetic(card.precision, device), device, card.ranges)

    @classmethod
    def load(cls, directory: Path, device: str = "cpu", precision: Precision | None = None) -> "Estimator":
        """Rebuild the estimator in `directory`; `precision` overrides what its card says, 8-bit integers included.

        Raises ArtifactError when a file is missing, damaged or newer than this code, MachineError without `device`.
        """
        card = _read_card(directory / CARD_FILE)
        if precision is not None:
            card = card.model_copy(update={"precision": precision, "ranges": None})
        network = _read_network(directory / WEIGHTS_FILE)
        if card.ranges is not None and len(card.ranges) != activations(network):
            raise ArtifactError(
                f"{directory / CARD_FILE}: ranges of {len(card.ranges)} activations, the network has "
                f"{activations(network)}; train the estimator again"
            )
        return cls(card, network, torch_device(device))

    def predict(self, images: np.ndarray) -> np.ndarray:
        """Images (n, h, w, 3) uint8 RGB → positions of the cube (n, 3) float32 [m], world frame.

        Raises ValueError for images of another shape or type.
        """
        expected = (self.image_size, self.image_size, 3)
        if images.shape[1:] != expected or images.dtype != np.uint8:
            raise ValueError(f"images are {images.dtype} {images.shape}, the estimator takes uint8 (n, *{expected})")
        if len(images) == 0:
            return np.empty((0, 3), np.float32)
        pixels = torch.from_numpy(np.ascontiguousarray(images)).to(self._device)
        normalisation = self.card.normalisation
        return normalisation.positions(self._network(normalisation.images(pixels)))


def _read_card(file: Path) -> EstimatorCard:
    try:
        fields = json.loads(file.read_bytes())
        version = fields["schema_version"]
        if version > SCHEMA_VERSION:
            raise ArtifactError(
                f"{file}: schema version {version} is newer than this code's {SCHEMA_VERSION}; update it"
            )
        return EstimatorCard.model_validate(fields)
    except OSError as error:
        raise ArtifactError(f"{file}: cannot be read ({error.strerror}); is the directory an estimator?") from error
    except (ValueError, KeyError, TypeError, RecursionError, ValidationError) as error:
        raise ArtifactError(f"{file}: damaged or not an estimator's; train it again ({error})") from error


def _read_network(file: Path) -> ResNet34:
    with torch.device("meta"):  # no random initialisation that the weights would replace at once
        network = ResNet34()
    try:
        network.load_state_dict(load_file(file), assign=True)
    except OSError as error:
        raise ArtifactError(
            f"{file}: cannot be read ({error.strerror or 'no such file'}); train the estimator again"
        ) from error
    except (SafetensorError, RuntimeError) as error:
        raise ArtifactError(f"{file}: damaged or not a ResNet34's weights; train the estimator again") from error
    for name, values in network.state_dict().items():
        if not values.isfinite().all():
            raise ArtifactError(f"{file}: {name} is not finite, nothing could be estimated; train the estimator again")
    return network
