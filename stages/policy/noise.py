"""Noise in time."""

import numpy as np


def correlated(white: np.ndarray, correlation: float) -> np.ndarray:
    """Independent draws (T, a) of unit variance as a stationary process of order 1: (T, a).

    x₀ = w₀, xₜ = ρ xₜ₋₁ + √(1 − ρ²) wₜ keeps the variance, and steps k apart correlate by ρᵏ: the Ornstein-Uhlenbeck
    process at discrete times (Lillicrap et al. 2016), begun in its steady state. With ρ = 0 it is `white`.
    """
    noise, fresh = white.copy(), np.sqrt(1.0 - correlation**2)
    for step in range(1, len(noise)):
        noise[step] = correlation * noise[step - 1] + fresh * white[step]
    return noise
