"""Where on the table most and least return is lost, in words."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from stages.analyze import formats
from stages.analyze.results import Row

_ENOUGH = 10
"""Episodes of a region, compared with the oracle's, that are enough to name it."""


def region_sentences(rows: Sequence[Row]) -> list[str]:
    """For each setting of dense and dense2sparse the regions that lose most and least."""
    settings: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        known = row["lost_return"] is not None and isfinite(row["lost_return"]) and row["compared"] >= _ENOUGH
        if row["scheme"] in ("dense", "dense2sparse") and known:
            key = (row["name"], row["task"], row["misalignment_kind"], row["misalignment_deg"], row["scheme"])
            settings.setdefault(key, []).append(row)
    return [_region_sentence(members) for members in settings.values() if len(members) > 1]


def _region_sentence(rows: Sequence[Row]) -> str:
    first = rows[0]
    most, least = (pick(rows, key=lambda row: row["lost_return"]) for pick in (max, min))
    where = f"{first['task']}, {formats.camera(first)}, {first['scheme']}"
    return f"{where}: most is lost at {_region(most)}, least at {_region(least)}."


def _region(row: Row) -> str:
    error = "no estimate" if row["estimation_error"] is None else f"estimate {100 * row['estimation_error']:.1f} cm off"
    return (
        f"x = {formats.signed(100 * row['x'], 0)} cm, y = {formats.signed(100 * row['y'], 0)} cm "
        f"({formats.figure(row['lost_return'])} of return, {error}, {row['compared']} episodes)"
    )
