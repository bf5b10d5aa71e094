"""Configuration of the analysis."""

from typing import Annotated

from pydantic import Field

from schemas.config import Config


class AnalyzeConfig(Config):
    """Statistics of the report."""

    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    bootstrap_samples: Annotated[int, Field(ge=100, le=1_000_000)] = 10_000
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Of the bootstrap."""
    recordings: Annotated[int, Field(ge=0, le=1000)] = 20
    """At most so many Rerun recordings of episodes beside the report, to which the points of the figures lead (2.3 MB
    and 1.5 s each): the best and the worst, each scheme's typical one, the ones where estimates are worst, then those
    of the studies' variants and of single runs. 20 are what the figures of 36 runs lead to but for their single seeds.
    0: none, of estimators neither."""


class AnalyzeStageConfig(Config):
    """Everything a report depends on, besides its runs and estimators."""

    analyze: AnalyzeConfig = AnalyzeConfig()
