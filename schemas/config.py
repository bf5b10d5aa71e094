"""Base of every configuration model, and what several of them say."""

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

Device = Literal["cpu", "cuda"]
Precision = Literal["float32", "bfloat16"]
"""Arithmetic of a network's large products; weights, sums and results are float32 in either."""


class Config(BaseModel):
    """Immutable; an unknown key is an error; numbers must be finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def flatten(config: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a nested configuration as (section.key, value)."""
    for key, value in config.items():
        if isinstance(value, dict) and value:
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
