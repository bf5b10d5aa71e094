"""Errors of position estimates. NumPy only; all in metres."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ErrorSummary:
    """Errors over n frames."""

    loss: float  # squared error summed over the axes, mean over frames [m²] (paper, equation 2 without its sign)
    mean_error: float  # Euclidean [m]: the paper's metric
    median_error: float
    p95_error: float
    bias: np.ndarray  # (3,) mean of estimate − truth on each axis [m]


def euclidean_errors(true: np.ndarray, estimated: np.ndarray) -> np.ndarray:
    """Distance of each estimate from the truth, (n, 3) and (n, 3) → (n,) [m]."""
    return np.linalg.norm(np.asarray(estimated, np.float64) - true, axis=1)


def summarise(true: np.ndarray, estimated: np.ndarray) -> ErrorSummary:
    """Summary over n ≥ 1 frames of `true` and `estimated` positions, both (n, 3) [m]."""
    errors = euclidean_errors(true, estimated)  # (n,)
    return ErrorSummary(
        loss=float(np.mean(errors**2)),
        mean_error=float(np.mean(errors)),
        median_error=float(np.median(errors)),
        p95_error=float(np.quantile(errors, 0.95)),
        bias=np.mean(np.asarray(estimated, np.float64) - true, axis=0),
    )
