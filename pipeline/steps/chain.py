"""The four stages in order, and the studies beside the main matrix."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.artifacts.store import Request
from pipeline.matrix import cells
from pipeline.steps import analyze, collect, perception, policy, studies
from pipeline.steps.policy import Matrix
from pipeline.steps.session import Outcome, Session, planned
from pipeline.steps.studies import LeftOut
from schemas.errors import ArtifactError

Announce = Callable[[int, int, str, str], None]


@dataclass(frozen=True)
class Done:
    """What one step did."""

    stage: str
    artifact: str
    outcomes: list[Outcome]
    seconds: float


@dataclass
class Chain:
    """What the stages did, in order; train-policy once for the matrix and once for all studies."""

    steps: list[Done] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    """What the report leaves out: interrupted variants of studies that were not asked for now."""

    def outcomes(self, stage: str) -> list[Outcome]:
        """Artifacts of one stage."""
        return [outcome for step in self.steps if step.stage == stage for outcome in step.outcomes]

    def seconds(self, stage: str) -> float:
        """Time that one stage took."""
        return sum(step.seconds for step in self.steps if step.stage == stage)

    @property
    def stages(self) -> list[str]:
        """Their names."""
        return list(dict.fromkeys(step.stage for step in self.steps))

    @property
    def cells(self) -> list[Outcome]:
        """Runs of the matrix and of the studies."""
        return self.outcomes("train-policy")

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.outcomes("analyze")[0].path / "report.html"

    @property
    def recordings(self) -> list[Path]:
        """Rerun recordings beside the report."""
        return sorted(self.report.parent.rglob("*.rrd"))


def run_chain(session: Session, name: str, asked: Sequence[str] = (), announce: Announce | None = None) -> Chain:
    """Make what is missing of datasets/NAME, estimators/NAME, runs/NAME/*, the studies asked for and reports/NAME.

    Runs that fail are reported on like the others: that they failed is a result.
    """
    chain = Chain()
    matrices = _matrices(session, name, asked)
    beside = matrices[1:]
    total = 5 if beside else 4

    def step(stage: str, artifact: str, work: Callable[[], list[Outcome]]) -> None:
        if announce:
            announce(len(chain.steps) + 1, total, stage, artifact)
        started = time.monotonic()
        outcomes = work()
        chain.steps.append(Done(stage, artifact, outcomes, time.monotonic() - started))

    step("collect", f"datasets/{name}", lambda: [collect.collect(session, name)])
    step("train-perception", f"estimators/{name}", lambda: [perception.train_perception(session, name, name)])
    _check(matrices, name)
    step("train-policy", f"runs/{name}", lambda: policy.train_policy(matrices[:1], name))
    if beside:
        step("train-policy", f"runs/{name}-*", lambda: policy.train_policy(beside, name))
    step("analyze", f"reports/{name}", lambda: [_analyze(session, name, chain)])
    return chain


def _matrices(session: Session, name: str, asked: Sequence[str]) -> list[Matrix]:
    """The main matrix, then every variant of the studies asked for."""
    return [Matrix(session, name), *studies.matrices(session, name, studies.chosen(session.config, asked))]


def _check(matrices: Sequence[Matrix], estimator: str) -> None:
    """Refuse what the last matrix would be refused for before the first is trained."""
    for matrix in matrices:
        perception.require_robot(matrix.session, estimator)
        policy.check(matrix, estimator)


def runs_of(session: Session, name: str, asked: Sequence[str] = ()) -> list[str]:
    """Ids of the runs of the matrix and of the studies asked for."""
    return [each for matrix in _matrices(session, name, asked) for each in _cells(matrix.session, matrix.name)]


def _cells(session: Session, name: str) -> list[str]:
    """Ids of the runs of a matrix."""
    return [f"runs/{name}/{cell.name}" for cell in cells(session.config.policy)]


def _analyze(session: Session, name: str, chain: Chain) -> Outcome:
    subject = analyze.subject(session, _cells(session, name), [name], base=name)
    chain.left_out = subject.left_out
    return analyze.analyze(session, name, subject)


def plan(session: Session, name: str, asked: Sequence[str] = ()) -> list[dict[str, Any]]:
    """What `run_chain` would do; what cannot be known before its inputs exist is said so."""
    steps = [
        *_planned(session, [f"datasets/{name}"], lambda: [collect.request(session, name)]),
        *_planned(session, [f"estimators/{name}"], lambda: [perception.request(session, name, name)]),
    ]
    matrices = _matrices(session, name, asked)
    for matrix in matrices:
        ids = _cells(matrix.session, matrix.name)
        steps += _planned(matrix.session, ids, partial(_requests, matrix, name))
    return [*steps, *_planned_report(session, name, matrices)]


def _requests(matrix: Matrix, estimator: str) -> list[Request]:
    return [request for _, request in policy.requests(matrix, estimator)]


def _planned_report(session: Session, name: str, matrices: Sequence[Matrix]) -> list[dict[str, Any]]:
    left_out: list[LeftOut] = []

    def requests() -> list[Request]:
        subject = analyze.subject(session, _cells(session, name), [name], base=name)
        wanted = {each for matrix in matrices[1:] for each in _cells(matrix.session, matrix.name)}
        request = analyze.request(session, name, subject)
        if request.grows or not wanted <= set(subject.studies.runs):
            raise ArtifactError("not all runs are finished", awaited=True)
        left_out.extend(subject.left_out)
        return [request]

    steps = _planned(session, [f"reports/{name}"], requests)
    return [*(each.planned() for each in left_out), *steps]


def _planned(session: Session, ids: list[str], requests: Callable[[], list[Request]]) -> list[dict[str, Any]]:
    try:
        asked = requests()
    except ArtifactError as error:
        if not error.awaited:
            raise
        return [{"id": each, "plan": "make, once its inputs are there"} for each in ids]
    return [planned(session, request) for request in asked]
