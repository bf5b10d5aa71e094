"""References to frames of a dataset."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np


class FrameRef(NamedTuple):
    """One kept frame; `file` is relative to the dataset's directory."""

    file: str
    episode: int
    step: int
    time_ns: int


Rerender = Callable[[Sequence[FrameRef], str, float], Iterator[np.ndarray]]
"""(frames, misalignment kind, degrees) → images (H, W, 3) uint8 of these states from the misaligned nominal camera."""
