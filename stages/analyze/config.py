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
    recordings: Annotated[int, Field(ge=0, le=1000)] = 4
    """Rerun recordings of episodes to write beside the report: the best, the worst, then each run's episode of median
    return, to which the run's points in the figures lead."""


class AnalyzeStageConfig(Config):
    """Everything a report depends on, besides its runs and estimators."""

    analyze: AnalyzeConfig = AnalyzeConfig()
