"""Statistics over seeds: few values, so intervals are bootstrapped and trimming is exact."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import comb

import numpy as np

from stages.analyze.config import AnalyzeConfig

BySeed = Mapping[int, float]
_DRAWN_AT_ONCE = 2_000_000  # numbers of resamples in memory


@dataclass(frozen=True)
class Summary:
    """Of one quantity over the seeds of a group. What one value cannot tell (spread, interval) is None."""

    n: int
    mean: float
    std: float | None  # sample standard deviation
    iqm: float
    low: float | None  # bootstrap interval of the mean
    high: float | None
    iqm_low: float | None  # bootstrap interval of the interquartile mean
    iqm_high: float | None


def summarise(values: np.ndarray, rng: np.random.Generator, samples: int, confidence: float) -> Summary | None:
    """Summary of `values` (n,), those that are not finite left out; None when none is left."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return None
    mean, iqm = float(np.mean(finite)), interquartile_mean(finite)
    if len(finite) == 1:
        return Summary(1, mean, None, iqm, None, None, None, None)
    low, high = bootstrap_interval(finite, rng, samples, confidence)
    iqm_low, iqm_high = bootstrap_interval(finite, rng, samples, confidence, _interquartile_means)
    return Summary(len(finite), mean, float(np.std(finite, ddof=1)), iqm, low, high, iqm_low, iqm_high)


def interquartile_mean(values: np.ndarray) -> float:
    """Mean of the middle half of `values` (n,): the quantile function integrated from 1/4 to 3/4, times two.

    When n is a multiple of four it is the mean without the lowest and the highest quarter (Agarwal et al. 2021); else
    the values at the edges count by the share of them that lies inside, instead of trimming nothing at n = 3.
    """
    if len(values) == 0:
        raise ValueError("the interquartile mean of no values")
    return float(_interquartile_means(values[None])[0])


def _interquartile_means(samples: np.ndarray) -> np.ndarray:
    """Of each of `samples` (m, n): (m,)."""
    n = samples.shape[1]
    edges = np.linspace(0.0, 1.0, n + 1)  # (n + 1,) the i-th sorted value covers edges[i] to edges[i + 1]
    inside = np.clip(edges, 0.25, 0.75)
    return np.average(np.sort(samples, axis=1), axis=1, weights=np.diff(inside))


def bootstrap_interval(
    values: np.ndarray,
    rng: np.random.Generator,
    samples: int = 10_000,
    confidence: float = 0.95,
    statistic: Callable[[np.ndarray], np.ndarray] = lambda resamples: resamples.mean(axis=1),
) -> tuple[float, float]:
    """Percentile bootstrap interval of `statistic`, which maps resamples (samples, n) to (samples,)."""
    if len(values) == 0:
        raise ValueError("a bootstrap of no values")
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(np.concatenate(list(_drawn(values, rng, samples, statistic))), [tail, 1.0 - tail])
    return float(low), float(high)


def _drawn(
    values: np.ndarray, rng: np.random.Generator, samples: int, statistic: Callable[[np.ndarray], np.ndarray]
) -> Iterator[np.ndarray]:
    """`statistic` of `samples` resamples, some at a time, so that many values need no more memory than few."""
    at_once = max(1, _DRAWN_AT_ONCE // len(values))
    for first in range(0, samples, at_once):
        size = min(at_once, samples - first), len(values)
        yield statistic(values[rng.integers(len(values), size=size)])


def paired_interval(
    a: np.ndarray,
    b: np.ndarray,
    rng: np.random.Generator,
    samples: int,
    confidence: float,
    statistic: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[float, float]:
    """Percentile bootstrap interval of `statistic` of the means of `a` (n,) and `b` (n,), drawn by the same indices."""
    drawn = rng.integers(len(a), size=(samples, len(a)))
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(statistic(a[drawn].mean(axis=1), b[drawn].mean(axis=1)), [tail, 1.0 - tail])
    return float(low), float(high)


def improvement_interval(
    a: np.ndarray, b: np.ndarray, rng: np.random.Generator, samples: int, confidence: float
) -> tuple[float, float]:
    """Percentile bootstrap interval of `probability_of_improvement`; both sides are drawn by themselves."""
    x = a[rng.integers(len(a), size=(samples, len(a)))]  # (samples, n)
    y = b[rng.integers(len(b), size=(samples, len(b)))]
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(_above(x, y).mean(axis=(1, 2)), [tail, 1.0 - tail])
    return float(low), float(high)


def probability_of_improvement(a: np.ndarray, b: np.ndarray) -> float:
    """That a value drawn from `a` (n,) exceeds one drawn from `b` (m,), ties counted half: the Mann–Whitney statistic.

    Agarwal et al. 2021, Deep reinforcement learning at the edge of the statistical precipice, §4.3.
    """
    return float(_above(a[None], b[None]).mean())


def _above(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of each pair of `a` (…, n) and `b` (…, m): 1 where a > b, a half where they are equal."""
    left, right = a[..., :, None], b[..., None, :]
    return (left > right) + 0.5 * (left == right)


def distinct_resamples(n: int) -> int:
    """How many different bootstrap samples `n` values have: with three it is 10, which bounds any interval's detail."""
    return comb(2 * n - 1, n)


class Statistics:
    """Summaries under one configuration; each quantity draws from the same seed, so that no order matters."""

    def __init__(self, config: AnalyzeConfig) -> None:
        self._config = config

    def of(self, values: Iterable[float | None]) -> Summary | None:
        """Summary of the values that are there."""
        array = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
        rng = np.random.default_rng(self._config.seed)
        return summarise(array, rng, self._config.bootstrap_samples, self._config.confidence)

    def improvement(self, a: Iterable[float], b: Iterable[float]) -> tuple[float, float | None, float | None] | None:
        """`probability_of_improvement` and its interval; None where a side is empty, no interval where it has one."""
        x, y = np.array(list(a)), np.array(list(b))
        if len(x) == 0 or len(y) == 0:
            return None
        value = probability_of_improvement(x, y)
        if min(len(x), len(y)) == 1:
            return value, None, None
        rng = np.random.default_rng(self._config.seed)
        return value, *improvement_interval(x, y, rng, self._config.bootstrap_samples, self._config.confidence)

    def paired(
        self, a: BySeed, b: BySeed, statistic: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[int, float, float | None, float | None] | None:
        """Number of common seeds, `statistic` of the two means, and its interval; None without a common seed.

        Both sides are resampled by the same seeds, which the schemes share. One seed has no interval.
        """
        seeds = sorted(set(a) & set(b))
        if not seeds:
            return None
        x, y = (np.array([side[seed] for seed in seeds]) for side in (a, b))  # (n,)
        value = float(statistic(x.mean(), y.mean()))
        if len(seeds) == 1:
            return 1, value, None, None
        rng = np.random.default_rng(self._config.seed)
        low, high = paired_interval(x, y, rng, self._config.bootstrap_samples, self._config.confidence, statistic)
        return len(seeds), value, low, high
