"""What a claim is. The paper's: `stages.analyze.paper_claims`; ours: `targets`; how they are judged: `rules`."""

from dataclasses import dataclass
from typing import Literal

Rule = Literal["above", "keeps", "level", "spread", "at least", "at most"]
Quantity = Literal["return", "success", "area", "error"]

WHAT: dict[Quantity, str] = {
    "return": "episode reward",
    "success": "success rate",
    "area": "area under the learning curve as a share of its own final level",
}
KEPT = 0.95
"""Share of the other's mean that counts as `keeps` or `nearly equals`."""
LEAST = 0.01
"""Share of the larger mean that a difference has at least: two policies that never touch the cube differ by less."""
NEAR = 0.10
"""Share of a level of the paper, read off its curves, within which our mean counts as the same."""


@dataclass(frozen=True)
class Setting:
    """A group of the matrix, whatever the name of its runs and the kind of its misalignment."""

    task: str
    misalignment_deg: float
    scheme: str


@dataclass(frozen=True)
class Claim:
    """`subject` against `rival` or against `value`, under `rule`. An estimator's error has no subject."""

    id: str
    statement: str
    source: str
    rule: Rule
    quantity: Quantity
    subject: Setting | None
    rival: Setting | None = None
    value: float | None = None
    """A return, a rate, an error [m]; with a rival the share of the rival's mean."""
    paper: str = ""
    """The paper's words or numbers as it gives them, with the place to find them in `source`."""

    @property
    def is_share(self) -> bool:
        """Whether the ratio of the means decides."""
        return self.value is not None and self.rival is not None


def at(degrees: float) -> str:
    """`5°`."""
    return f"{degrees:g}°"


def number(value: float, quantity: Quantity) -> str:
    """A return as it is, a rate in percent."""
    return f"{100 * value:g} %" if quantity == "success" else f"{value:g}"


def estimator(id: str, statement: str, source: str, limit: float) -> Claim:
    """An error [m] of the estimator that is at most `limit`."""
    return Claim(id, statement, source, "at most", "error", None, value=limit, paper=f"{100 * limit:g} cm")
