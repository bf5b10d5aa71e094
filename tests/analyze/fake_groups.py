"""Groups and claims whose numbers one can check by hand."""

from typing import Any

from stages.analyze.claims import Claim, Setting
from stages.analyze.config import AnalyzeConfig
from stages.analyze.results import Group, groups
from stages.analyze.statistics import Statistics
from stages.analyze.verdicts import Judged, judge

STATISTICS = Statistics(AnalyzeConfig(bootstrap_samples=500))
A, B = Setting("reach", 0, "dense2sparse"), Setting("reach", 0, "dense")
ABOVE = Claim("id", "a above b", "§", "above", "return", A, B)
KEEPS = Claim("id", "a keeps b", "§", "keeps", "return", A, B, value=0.95)
LEVEL = Claim("id", "a about 100", "§", "level", "return", A, value=100.0)
SHARE = Claim("id", "a at least of b", "target", "at least", "return", A, B, value=0.95)
SPREAD = Claim("id", "a varies more than b", "§", "spread", "success", B, A)


def group(
    scheme: str, returns: tuple[float, ...], failed: tuple[int, ...] = (), rate: float = 1 / 200, **changes: Any
) -> Group:
    """A group of reach at 0° whose seeds 0, 1, … end at `returns`, and succeed at `rate` times that."""
    identity = {"name": "main", "task": "reach", "misalignment_kind": "orbit", "misalignment_deg": 0.0}
    common = identity | {"scheme": scheme, "buffer": "keep", "reset": "none"} | changes
    seeds = dict.fromkeys(range(len(returns)), "complete") | dict.fromkeys(failed, "failed")
    runs = [common | {"run": f"main/{seed}", "seed": seed, "status": status} for seed, status in seeds.items()]
    outcome = {"split": "final", "episodes": 200, "mean_steps_to_success": None, "mean_estimation_error": None}
    outcomes = [
        outcome | {"run": f"main/{seed}", "seed": seed, "mean_return": value, "success_rate": value * rate}
        for seed, value in enumerate(returns)
    ]
    (made,) = groups(runs, outcomes, [{"run": "main/0", "seed": 0, "area": 50.0}], STATISTICS)
    return made


def verdict(claim: Claim, *made: Group) -> Judged:
    """The one verdict on `claim`."""
    (judged,) = judge([claim], made, {}, STATISTICS)
    return judged
