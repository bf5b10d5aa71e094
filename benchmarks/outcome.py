"""What a benchmark found: ratios and their targets, where the time goes, and what the machine could do at best."""

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Target:
    """A figure and the bound that it is measured against."""

    name: str
    value: float
    bound: float
    unit: str = ""
    at_least: bool = True
    """Whether the figure should be at least the bound, else at most."""

    @property
    def met(self) -> bool:
        """Whether the figure keeps its bound."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


@dataclass(frozen=True)
class Part:
    """One part of the work, per unit of it (see `Outcome.unit`)."""

    name: str  # physics, control, render, transfer, inference, update, log, …
    milliseconds: float
    limit: float | None = None
    """Milliseconds that the same work takes at the speed this machine reaches bare; None: no such limit measured."""


@dataclass(frozen=True)
class Outcome:
    """The result of one benchmark; every figure is of one and the same run."""

    benchmark: str
    compares: str
    """What is compared with what, in a sentence."""
    unit: str
    """What a part's milliseconds are spent on: an environment step, a frame, …"""
    targets: list[Target]
    figures: dict[str, float] = field(default_factory=dict)
    """Everything else measured, its unit in the name: `stock [steps/s]`."""
    parts: list[Part] = field(default_factory=list)
    cores: int = 1
    """Over how many cores the parts are spread at best."""
    rounds: dict[str, list[float]] = field(default_factory=dict)
    """Rates of each contender, round by round: equal positions were measured one after the other."""
    bare_speeds: dict[str, float] = field(default_factory=dict)
    """Speeds that the limits are computed from, unit in the name."""
    table: list[dict[str, Any]] = field(default_factory=list)
    """Rows of a further table, where there is one."""
    notes: list[str] = field(default_factory=list)

    @property
    def limit_ms(self) -> float | None:
        """Least milliseconds for a unit of work: all limited parts at bare speed, spread over the cores."""
        limits = [part.limit for part in self.parts if part.limit is not None]
        return sum(limits) / self.cores if limits else None

    def as_json(self) -> dict[str, Any]:
        """Plain data for `--json`."""
        targets = [asdict(target) | {"met": target.met} for target in self.targets]
        return asdict(self) | {"targets": targets, "limit_ms": self.limit_ms}
