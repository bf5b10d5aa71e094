"""train-policy → runs/NAME/CELL, one artifact per cell, trained together."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, NamedTuple

from pipeline import interrupts
from pipeline.artifacts.space import require_space
from pipeline.artifacts.store import Build, Request
from pipeline.machine import require_device, require_gl, require_sim
from pipeline.matrix import Cell, cells
from pipeline.steps.session import Did, Outcome, Session
from schemas.manifest import InputRef, Manifest
from stages.policy.config import IN_METRES, RunConfig, acts_on_truth
from stages.sim.config import WorldConfig

if TYPE_CHECKING:
    from stages.policy.config import RunResult, RunSpec

BYTES_PER_STEP = 400
"""A row of transitions.parquet, compressed."""


class Matrix(NamedTuple):
    """One matrix of runs: what it is trained with, and its NAME."""

    session: Session
    name: str
    sources: tuple[str, ...] = ()
    """Ids of runs or of new labels from whose transitions alone it learns; none: from its own steps."""


class Work(NamedTuple):
    """A cell that is to be trained now."""

    matrix: Matrix
    cell: Cell
    build: Build

    @property
    def run_id(self) -> str:
        return f"{self.matrix.name}/{self.cell.name}"


def estimator_needed(session: Session) -> bool:
    """Some cell acts on estimates; the oracle acts on the truth, unless it is told otherwise."""
    return not all(acts_on_truth(cell.scheme, cell.config) for cell in cells(session.config.policy))


def requests(matrix: Matrix, estimator: str | None) -> list[tuple[Cell, Request]]:
    """Every cell of the matrix and the artifact it becomes.

    With an estimator all cells use it: an oracle does not act on it, but logs what it would have been told.
    """
    session = matrix.session
    ids = [*([f"estimators/{estimator}"] if estimator else []), *matrix.sources]
    inputs = [session.pin(each) for each in ids]
    return [(cell, _request(matrix, cell, estimator, inputs)) for cell in cells(session.config.policy)]


def _request(matrix: Matrix, cell: Cell, estimator: str | None, inputs: list[InputRef]) -> Request:
    config = {
        "world": matrix.session.config.world.model_dump(mode="json"),
        "policy": cell.config.model_dump(mode="json"),
        "run": cell.identity,
        "estimator": estimator,
        **({"sources": list(matrix.sources)} if matrix.sources else {}),
    }
    older = RunConfig(observation_scale=IN_METRES)
    defaults = {"world": WorldConfig().model_dump(mode="json"), "policy": older.model_dump(mode="json")}
    device = matrix.session.config.policy.device
    return Request(f"runs/{matrix.name}/{cell.name}", config, inputs, defaults, device)


def space_needed(work: Sequence[Work]) -> int:
    """Estimate [bytes] of the logs of the cells to train."""
    return sum(BYTES_PER_STEP * item.matrix.session.config.world.horizon * _episodes(item.cell) for item in work)


def _episodes(cell: Cell) -> int:
    config = cell.config
    evaluations = config.episodes // config.eval_every
    return config.episodes + evaluations * config.eval_episodes + config.final_episodes


def check(matrix: Matrix, estimator: str | None) -> list[tuple[Cell, Request]]:
    """The requests, none of which is refused: a name taken by another config shows before any cell is begun."""
    asked = requests(matrix, estimator)
    for _, request in asked:
        matrix.session.store.existing(request, matrix.session.resume)
    return asked


def train_policy(matrices: Sequence[Matrix], estimator: str | None) -> list[Outcome]:
    """Train the cells that are not complete, all together; a cell that fails does not stop the others."""
    asked = [(matrix, cell, request) for matrix in matrices for cell, request in check(matrix, estimator)]
    outcomes: dict[str, Outcome] = {}
    with ExitStack() as stack:
        work: list[Work] = []
        for matrix, cell, request in asked:
            session = matrix.session
            begun = session.store.begin(request, session.resume)
            if isinstance(begun, Manifest):
                outcomes[request.id] = _outcome(session, request.id, "nothing", begun, 0.0)
            else:
                work.append(Work(matrix, cell, stack.enter_context(begun)))
        if work:
            outcomes |= _train(matrices[0].session, work, estimator)
    return [outcomes[request.id] for *_, request in asked]


def _train(session: Session, work: list[Work], estimator: str | None) -> dict[str, Outcome]:
    _prepare(session, work, estimator is not None)
    from stages.policy.resources import Resources
    from stages.policy.train import run  # loads MuJoCo, which must not fail before the checks say why

    started = time.monotonic()
    matrix = session.config.policy
    items = {item.run_id: item for item in work}
    done: dict[str, Outcome] = {}

    def finished(result: "RunResult") -> None:
        outcome = _finish(items[result.run_id], result, time.monotonic() - started)
        done[outcome.id] = outcome

    with interrupts.finishing():
        run(
            [_spec(item) for item in work],
            session.store.path(f"estimators/{estimator}") if estimator else None,
            resources=Resources(matrix.device, matrix.processes, matrix.workers, matrix.threads),
            finished=finished,
            progress=session.progress,
        )
    return done


def _prepare(session: Session, work: list[Work], renders: bool) -> None:
    """Check GPU, GL and disk before hours of work."""
    require_device(session.config.policy.device)
    require_space(session.root, space_needed(work))
    require_sim()
    if renders:
        renderer = require_gl()
        for item in work:
            item.build.note_renderer(renderer)


def _spec(item: Work) -> "RunSpec":
    from stages.policy.config import RunSpec

    cell = item.cell
    return RunSpec(
        run_id=item.run_id,
        task=cell.task,
        scheme=cell.scheme,
        misalignment_kind=cell.misalignment_kind,
        misalignment_deg=cell.misalignment_deg,
        seed=cell.seed,
        world=item.matrix.session.config.world,
        config=cell.config,
        out=item.build.path,
        sources=tuple(item.matrix.session.store.path(each) for each in item.matrix.sources),
    )


def _finish(item: Work, result: "RunResult", seconds: float) -> Outcome:
    """Close the cell's manifest by how its run ended."""
    session = item.matrix.session
    if result.status == "failed":
        manifest = item.build.fail(result.error or "no reason given", result.summary)
        return _outcome(session, manifest.id, "failed", manifest, seconds)
    manifest = item.build.finish(result.summary)
    return _outcome(session, manifest.id, "resumed" if item.build.resumed else "made", manifest, seconds)


def _outcome(session: Session, artifact_id: str, did: Did, manifest: Manifest, seconds: float) -> Outcome:
    return Outcome(artifact_id, session.store.path(artifact_id), did, manifest.summary, seconds)
