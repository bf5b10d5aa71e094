"""Statistics of features as LeRobot keeps them, for every episode and for all together."""

from collections.abc import Sequence

import numpy as np

Statistics = dict[str, np.ndarray]
"""min, max, mean, std, count and quantiles (q01 …): (d,) of a vector, (3, 1, 1) of an image; count is (1,)."""

_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def of_rows(values: np.ndarray) -> Statistics:
    """Of each component of the rows (n,) or (n, d)."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    quantiles = np.quantile(rows, list(_QUANTILES.values()), axis=0)
    return {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        "count": np.array([len(rows)]),
        **dict(zip(_QUANTILES, quantiles, strict=True)),
    }


def of_images(images: np.ndarray) -> Statistics:
    """Of each channel of images (n, H, W, 3) uint8, as fractions of 1: from how often each byte is there."""
    channels = [_of_histogram(np.bincount(images[..., i].ravel(), minlength=256)) for i in range(images.shape[-1])]
    found = {name: np.array([each[name] for each in channels]).reshape(-1, 1, 1) for name in channels[0]}
    return {**found, "count": np.array([len(images)])}


def _of_histogram(counts: np.ndarray) -> dict[str, float]:
    """Of as many bytes of each value as `counts` (256,) says."""
    values, total = np.arange(256) / 255, counts.sum()
    there = np.flatnonzero(counts)
    mean = (counts * values).sum() / total
    below = counts.cumsum()
    return {
        "min": values[there[0]],
        "max": values[there[-1]],
        "mean": mean,
        "std": np.sqrt((counts * (values - mean) ** 2).sum() / total),
        **{name: values[np.searchsorted(below, q * total)] for name, q in _QUANTILES.items()},
    }


def together(episodes: Sequence[Statistics]) -> Statistics:
    """Of all rows of several episodes. Quantiles are the episodes' means weighted by length, which is LeRobot's way."""
    each = {name: np.stack([one[name] for one in episodes]) for name in episodes[0]}
    count = each["count"].reshape(-1, *[1] * (each["mean"].ndim - 1))  # (episodes, 1, …)
    total = count.sum(axis=0)

    def weighted(values: np.ndarray) -> np.ndarray:
        return (values * count).sum(axis=0) / total

    mean = weighted(each["mean"])
    return {
        "min": each["min"].min(axis=0),
        "max": each["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(weighted(each["std"] ** 2 + (each["mean"] - mean) ** 2)),
        "count": each["count"].sum(axis=0),
        **{name: weighted(each[name]) for name in _QUANTILES},
    }
