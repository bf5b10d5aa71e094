"""analyze → reports/NAME."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.artifacts.inputs import input_ref, load, load_complete
from pipeline.artifacts.names import existing_ids, split_id
from pipeline.artifacts.store import Build, Request
from pipeline.steps.session import Outcome, Session, make
from schemas.errors import ArtifactError
from stages.analyze.config import AnalyzeStageConfig


def inputs(session: Session, runs: Sequence[str], estimators: Sequence[str]) -> list[str]:
    """Ids of the runs (NAME means all its cells) and estimators to report on; both empty: all that are finished.

    A failed run is finished: that it failed is a result. The estimators that runs used are shown with them, so they
    are inputs too, unless they are gone.
    """
    if not runs and not estimators:
        every = [*existing_ids(session.root, "runs"), *existing_ids(session.root, "estimators")]
        finished = [each for each in every if load(session.root, each).status in _accepted(each)]
        if not finished:
            raise ArtifactError(f"nothing to analyze under {session.root}: no finished run and no finished estimator")
        return finished
    cells = [cell for name in runs for cell in expand(session.root, name)]
    named = [f"estimators/{name.removeprefix('estimators/')}" for name in estimators]
    return list(dict.fromkeys([*cells, *named, *_used(session.root, cells)]))


def _used(root: Path, cells: Sequence[str]) -> list[str]:
    """Ids of the estimators that were inputs of the runs and are still there."""
    there = existing_ids(root, "estimators")
    return [ref.id for cell in cells for ref in load(root, cell).inputs if ref.id in there]


def _accepted(artifact_id: str) -> tuple[str, ...]:
    return ("complete", "failed") if artifact_id.startswith("runs/") else ("complete",)


def expand(root: Path, name: str) -> list[str]:
    """Ids of the cells that NAME or NAME/CELL means."""
    name = name.removeprefix("runs/").strip("/")
    there = existing_ids(root, "runs")
    found = [each for each in there if each == f"runs/{name}" or each.startswith(f"runs/{name}/")]
    if not found:
        names = ", ".join(sorted({split_id(each)[1][0] for each in there})) or "no runs"
        raise ArtifactError(f"no run {name!r} under {root}; there: {names}", awaited=True)
    return found


def request(session: Session, name: str, ids: Sequence[str]) -> Request:
    """The report asked for, every input verified and pinned."""
    for each in ids:
        load_complete(session.root, each, accepted=_accepted(each))
    config = AnalyzeStageConfig(analyze=session.config.analyze).model_dump(mode="json")
    return Request(f"reports/{name}", config, [input_ref(session.root, each) for each in ids])


def analyze(session: Session, name: str, runs: Sequence[str] = (), estimators: Sequence[str] = ()) -> Outcome:
    """Write a report on runs and estimators."""
    ids = inputs(session, runs, estimators)

    def stage(build: Build) -> dict[str, Any]:
        from pipeline.camera_views import write_camera_views
        from pipeline.recordings import record_episode
        from stages.analyze.run import run

        estimators = [each for each in ids if each.startswith("estimators/")]
        write_camera_views(session.store, estimators, build.path / "figures")
        return run(
            session.config.analyze,
            session.root,
            [each.removeprefix("runs/") for each in ids if each.startswith("runs/")],
            [each.removeprefix("estimators/") for each in estimators],
            build.path,
            record_episode=record_episode(session.root),
            progress=session.progress,
        )

    return make(session, request(session, name, ids), stage)
