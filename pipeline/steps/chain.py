"""The four stages in order."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.artifacts.store import Request
from pipeline.matrix import cells
from pipeline.steps import analyze, collect, perception, policy
from pipeline.steps.session import Outcome, Session, planned
from schemas.errors import ArtifactError

Announce = Callable[[int, str, str], None]


@dataclass
class Chain:
    """What the stages did."""

    outcomes: dict[str, list[Outcome]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def cells(self) -> list[Outcome]:
        """Runs of the matrix."""
        return self.outcomes["train-policy"]

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.outcomes["analyze"][0].path / "report.html"

    @property
    def recordings(self) -> list[Path]:
        """Rerun recordings beside the report."""
        return sorted(self.report.parent.rglob("*.rrd"))


def run_chain(session: Session, name: str, announce: Announce | None = None) -> Chain:
    """Make what is missing of datasets/NAME, estimators/NAME, runs/NAME/* and reports/NAME.

    Runs that fail are reported on like the others: that they failed is a result.
    """
    chain = Chain()
    stages: list[tuple[str, str, Callable[[], list[Outcome]]]] = [
        ("collect", f"datasets/{name}", lambda: [collect.collect(session, name)]),
        ("train-perception", f"estimators/{name}", lambda: [perception.train_perception(session, name, name)]),
        ("train-policy", f"runs/{name}", lambda: policy.train_policy(session, name, name)),
        ("analyze", f"reports/{name}", lambda: [_analyze(session, name, chain.cells)]),
    ]
    for number, (stage, artifact, step) in enumerate(stages, start=1):
        if announce:
            announce(number, stage, artifact)
        started = time.monotonic()
        chain.outcomes[stage] = step()
        chain.seconds[stage] = time.monotonic() - started
    return chain


def _analyze(session: Session, name: str, runs: list[Outcome]) -> Outcome:
    return analyze.analyze(session, name, [run.id for run in runs], [name])


def plan(session: Session, name: str) -> list[dict[str, Any]]:
    """What `run_chain` would do; what cannot be known before its inputs exist is said so."""
    runs = [f"runs/{name}/{cell.name}" for cell in cells(session.config.policy)]
    return [
        *_planned(session, [f"datasets/{name}"], lambda: [collect.request(session, name)]),
        *_planned(session, [f"estimators/{name}"], lambda: [perception.request(session, name, name)]),
        *_planned(session, runs, lambda: [request for _, request in policy.requests(session, name, name)]),
        *_planned(session, [f"reports/{name}"], lambda: [_report_request(session, name, runs)]),
    ]


def _report_request(session: Session, name: str, runs: list[str]) -> Request:
    return analyze.request(session, name, analyze.inputs(session, runs, [name]))


def _planned(session: Session, ids: list[str], requests: Callable[[], list[Request]]) -> list[dict[str, Any]]:
    try:
        asked = requests()
    except ArtifactError as error:
        if not error.awaited:
            raise
        return [{"id": each, "plan": "make, once its inputs are there"} for each in ids]
    return [planned(session, request) for request in asked]
