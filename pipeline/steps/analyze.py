"""analyze → reports/NAME."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.artifacts.inputs import input_ref, load, load_complete, load_shown
from pipeline.artifacts.names import existing_ids, split_id
from pipeline.artifacts.store import Build, Request
from pipeline.steps import studies
from pipeline.steps.session import Outcome, Session, make
from pipeline.steps.studies import FINISHED, LeftOut, Reported
from schemas.errors import ArtifactError
from stages.analyze.config import AnalyzeStageConfig


@dataclass(frozen=True)
class Subject:
    """What a report is on."""

    runs: list[str]  # ids of the cells
    estimators: list[str]  # ids
    studies: Reported
    left_out: list[LeftOut]

    @property
    def ids(self) -> list[str]:
        """Every input of the report, the studies' last."""
        return list(dict.fromkeys([*self.runs, *self.estimators, *self.studies.runs]))


def subject(session: Session, runs: Sequence[str], estimators: Sequence[str], base: str | None = None) -> Subject:
    """Runs (NAME means its finished cells, NAME/CELL that one) and estimators to report on; both empty: all there is.

    Where no run is finished it is those that are being trained, as far as they have come; so is NAME/CELL.

    The configuration's studies whose runs lie beside the matrix `base` come with it, so do the estimators that runs
    used, unless they are gone.

    Raises:
        ArtifactError: a name that is not there, or nothing at all.
    """
    root = session.root
    told = studies.finished(session, base) if base else Reported([], [], [])
    if not runs and not estimators:
        cells, left_out = _reported(root, existing_ids(root, "runs"))
        made = [each for each in existing_ids(root, "estimators") if load(root, each).status == "complete"]
        if not cells and not made:
            raise ArtifactError(f"nothing to analyze under {root}: no run and no finished estimator")
        return Subject(cells, made, told, left_out)
    cells, left_out = [], []
    for name in runs:
        found, unfinished = expand(root, name)
        cells += found
        left_out += unfinished
    named = [f"estimators/{name.removeprefix('estimators/')}" for name in estimators]
    cells = list(dict.fromkeys(cells))
    return Subject(
        cells, list(dict.fromkeys([*named, *_used(root, [*cells, *told.runs])])), told, [*left_out, *told.left_out]
    )


def _used(root: Path, cells: Sequence[str]) -> list[str]:
    """Ids of the estimators that were inputs of the runs and are still there."""
    there = existing_ids(root, "estimators")
    return [ref.id for cell in cells for ref in load(root, cell).inputs if ref.id in there]


def _reported(root: Path, cells: list[str]) -> tuple[list[str], list[LeftOut]]:
    """Those that are finished, and how many of each NAME are not; where none is, all as far as they have come."""
    finished = [each for each in cells if load(root, each).status in FINISHED]
    if not finished:
        return cells, []
    left_out = []
    for name in dict.fromkeys(each.rpartition("/")[0] for each in cells):
        of, done = (sum(each.startswith(f"{name}/") for each in group) for group in (cells, finished))
        if done < of:
            left_out.append(LeftOut(name, of - done, of, of - done))
    return finished, left_out


def expand(root: Path, name: str) -> tuple[list[str], list[LeftOut]]:
    """Ids of the cells that NAME or NAME/CELL means, and what is left out of a NAME that is finished in part."""
    name = name.removeprefix("runs/").strip("/")
    there = existing_ids(root, "runs")
    if f"runs/{name}" in there:
        return [f"runs/{name}"], []
    cells = [each for each in there if each.startswith(f"runs/{name}/")]
    if not cells:
        names = ", ".join(sorted({split_id(each)[1][0] for each in there})) or "no runs"
        raise ArtifactError(f"no run {name!r} under {root}; there: {names}", awaited=True)
    return _reported(root, cells)


def request(session: Session, name: str, subject: Subject) -> Request:
    """The report asked for, every input verified and pinned, but for the files of a run that is being trained."""
    runs = [load_shown(session.root, each) for each in subject.ids if each.startswith("runs/")]
    for each in subject.estimators:
        load_complete(session.root, each)
    config = AnalyzeStageConfig(analyze=session.config.analyze).model_dump(mode="json")
    inputs = [input_ref(session.root, each) for each in subject.ids]
    grows = any(each.status == "running" for each in runs)
    return Request(f"reports/{name}", {**config, **subject.studies.as_config()}, inputs, grows=grows)


def analyze(session: Session, name: str, subject: Subject) -> Outcome:
    """Write a report; the summary says how many runs were left out of it."""

    def stage(build: Build) -> dict[str, Any]:
        from pipeline.camera_views import write_camera_views
        from pipeline.recordings import Recorder
        from stages.analyze.run import run

        write_camera_views(session.store, subject.estimators, build.path / "figures")
        return run(
            session.config.analyze,
            session.root,
            [each.removeprefix("runs/") for each in subject.runs],
            [each.removeprefix("estimators/") for each in subject.estimators],
            build.path,
            studies=subject.studies.studies,
            left_out={each.id.removeprefix("runs/"): each.unfinished for each in subject.left_out},
            recorder=Recorder(session.root),
            progress=session.progress,
        )

    outcome = make(session, request(session, name, subject), stage)
    left_out = sum(each.left_out for each in subject.left_out)
    return replace(outcome, summary={**outcome.summary, "runs_left_out": left_out})
