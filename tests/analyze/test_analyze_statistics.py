"""Statistics over seeds, at values a reader can check by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.analyze.statistics import (
    bootstrap_interval,
    distinct_resamples,
    interquartile_mean,
    paired_interval,
    summarise,
)

values = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30).map(np.array)


def test_interquartile_mean_drops_a_quarter_at_each_end() -> None:
    assert interquartile_mean(np.array([100.0, 2.0, -50.0, 4.0])) == 3.0


def test_interquartile_mean_of_three_weighs_the_outer_two_a_sixth_each() -> None:
    # sorted 0, 3, 12: thirds of the quantile function, of which [1/4, 3/4] covers 1/12, 1/3 and 1/12
    assert interquartile_mean(np.array([12.0, 0.0, 3.0])) == pytest.approx((0 + 4 * 3 + 12) / 6)


@given(values)
def test_interquartile_mean_lies_between_the_extremes_whatever_the_order(array: np.ndarray) -> None:
    iqm = interquartile_mean(array)
    slack = 1e-9 * (1 + np.abs(array).max())
    assert array.min() - slack <= iqm <= array.max() + slack
    assert interquartile_mean(array[::-1]) == iqm


@given(values, st.floats(-1e3, 1e3))
def test_interquartile_mean_moves_with_the_values(array: np.ndarray, shift: float) -> None:
    assert interquartile_mean(array + shift) == pytest.approx(interquartile_mean(array) + shift, rel=1e-9, abs=1e-6)


@given(values, st.integers(0, 2**31 - 1))
def test_bootstrap_interval_lies_within_the_values_and_repeats_with_its_seed(array: np.ndarray, seed: int) -> None:
    low, high = bootstrap_interval(array, np.random.default_rng(seed), samples=100)
    slack = 1e-9 * (1 + np.abs(array).max())
    assert array.min() - slack <= low <= high <= array.max() + slack
    assert (low, high) == bootstrap_interval(array, np.random.default_rng(seed), samples=100)


def test_bootstrap_interval_of_constant_values_is_that_value() -> None:
    assert bootstrap_interval(np.full(5, 7.0), np.random.default_rng(0)) == (7.0, 7.0)


def test_bootstrap_interval_of_two_values_spans_both() -> None:
    # resample means are 0, 1/2 and 1 with probabilities 1/4, 1/2, 1/4: the outer 2.5 % lie in the outer quarters
    assert bootstrap_interval(np.array([0.0, 1.0]), np.random.default_rng(0)) == (0.0, 1.0)
    # at 40 % confidence the tails of 30 % reach past the outer quarters
    assert bootstrap_interval(np.array([0.0, 1.0]), np.random.default_rng(0), confidence=0.4) == (0.5, 0.5)


def test_summary_of_two_seeds() -> None:
    summary = summarise(np.array([10.0, 14.0]), np.random.default_rng(0), 1000, 0.95)
    assert summary is not None
    assert (summary.n, summary.mean, summary.iqm, summary.low, summary.high) == (2, 12.0, 12.0, 10.0, 14.0)
    assert summary.std == pytest.approx(8**0.5)  # sample standard deviation: ((−2)² + 2²) / (2 − 1)


def test_the_interquartile_mean_has_an_interval_of_its_own() -> None:
    """Of 0, 0, 0, 12. Resamples without a 12: 32 %, with one: 42 % (mean 3, interquartile mean 0), with more: 26 %."""
    summary = summarise(np.array([0.0, 0.0, 0.0, 12.0]), np.random.default_rng(0), 5000, 0.44)
    assert summary is not None
    assert (summary.mean, summary.low, summary.high) == (3.0, 0.0, 3.0)
    assert (summary.iqm, summary.iqm_low, summary.iqm_high) == (0.0, 0.0, 0.0)
    alone = summarise(np.array([3.0]), np.random.default_rng(0), 1000, 0.95)
    assert alone is not None
    assert (alone.iqm_low, alone.iqm_high) == (None, None)


def test_summary_of_one_seed_claims_no_spread() -> None:
    summary = summarise(np.array([3.0, np.nan]), np.random.default_rng(0), 1000, 0.95)
    assert summary is not None
    assert (summary.n, summary.mean, summary.std, summary.low, summary.high) == (1, 3.0, None, None, None)


def test_summary_of_nothing_is_nothing() -> None:
    assert summarise(np.array([np.nan, np.inf]), np.random.default_rng(0), 1000, 0.95) is None
    with pytest.raises(ValueError, match="no values"):
        interquartile_mean(np.array([]))


def test_three_seeds_have_ten_distinct_resamples() -> None:
    assert [distinct_resamples(n) for n in (1, 2, 3, 4)] == [1, 3, 10, 35]


def test_paired_interval_draws_both_sides_by_the_same_seeds() -> None:
    """Unpaired, differences of −100 to +102 would be drawn; paired there is only the one."""
    a, b = np.array([1.0, 102.0]), np.array([0.0, 101.0])
    assert paired_interval(a, b, np.random.default_rng(0), 500, 0.95, np.subtract) == (1.0, 1.0)
    low, high = paired_interval(a, np.array([1.0, 51.0]), np.random.default_rng(0), 500, 0.95, np.divide)
    assert (low, high) == (1.0, 2.0)  # 1 / 1 and 102 / 51 at the ends
