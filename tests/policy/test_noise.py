"""Exploration noise in time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.policy.noise import correlated


def test_by_hand() -> None:
    """ρ = 0.6: each step keeps 0.6 of the last and takes 0.8 of its own draw."""
    white = np.array([[1.0, 0.0], [0.5, 1.0], [0.0, -1.0]])
    expected = [[1.0, 0.0], [0.6 + 0.4, 0.8], [0.6, 0.48 - 0.8]]
    np.testing.assert_allclose(correlated(white, 0.6), expected)


def test_without_correlation_it_is_what_was_drawn() -> None:
    white = np.random.default_rng(0).standard_normal((200, 8))
    assert np.array_equal(correlated(white, 0.0), white)


@given(st.floats(0, 0.95), st.integers(0, 2**31))
def test_it_is_as_wide_as_white_noise_in_every_step(correlation: float, seed: int) -> None:
    """Over many sequences: unit variance at the first, a middle and the last step; neighbours correlate as asked."""
    noise = correlated(np.random.default_rng(seed).standard_normal((20, 20_000)), correlation)
    assert noise[[0, 10, 19]].std(axis=1) == pytest.approx([1, 1, 1], abs=0.03)
    assert float((noise[10] * noise[11]).mean()) == pytest.approx(correlation, abs=0.05)
