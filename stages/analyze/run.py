"""The analysis: logs in, one report with its figures, tables, evidence and recordings out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from schemas.files import write_bytes
from schemas.progress import Progress
from stages.analyze import behind, curves_recording, evidence, report, tables
from stages.analyze.behind import Links, Recorder, Recording
from stages.analyze.config import AnalyzeConfig
from stages.analyze.derived import derive, estimator_errors
from stages.analyze.drawn import draw
from stages.analyze.figures import cameras, export
from stages.analyze.results import Answer, Group, rows_of
from stages.analyze.studies import Study
from stages.analyze.study import Selection, ask_all, choose


def run(
    config: AnalyzeConfig,
    data_root: Path,
    runs: Sequence[str],
    estimators: Sequence[str],
    out: Path,
    *,
    studies: Sequence[Study] = (),
    left_out: Mapping[str, int] = {},
    recorder: Recorder | None,
    progress: Progress,
) -> dict[str, Any]:
    """Write report.html, README.md, provenance.json, config.toml, figures/, tables/ and recordings into `out`.

    `runs` are NAMEs or NAME/CELL, `estimators` NAMEs; with neither, everything under `data_root` is analysed. The runs
    of `studies` appear in the studies' tables only; `left_out` says of how many runs of each NAME the report does not
    know, because they are not finished. Returns the summary for the manifest.

    Raises:
        ArtifactError: an unknown name, nothing to analyse, or logs that cannot be read.
    """
    selection = choose(data_root, runs, estimators, studies)
    answers = ask_all(data_root, selection, progress)
    derived = derive(config, selection.studies, answers)
    recorded = _record(config, selection, answers, out, recorder, progress)
    contents = report.Contents(
        config=config,
        selection=selection,
        answers=answers,
        derived=derived,
        drawn=draw(answers, derived, selection.studies, Links(recorded)),
        recordings=recorded,
        cameras=cameras.pictures(out / "figures"),
        left_out=left_out,
    )
    _write(contents, out, progress)
    return _summary(contents)


def _record(
    config: AnalyzeConfig,
    selection: Selection,
    answers: dict[str, Answer],
    out: Path,
    recorder: Recorder | None,
    progress: Progress,
) -> list[Recording]:
    made = []
    curves = rows_of(answers, "learning-curves")
    if curves:
        made.append(curves_recording.write_comparison(curves, out / curves_recording.COMPARISON_FILE))
    if recorder is not None and config.recordings:
        episodes = rows_of(answers, "episodes-behind")
        watched = behind.choose(episodes, rows_of(answers, "regions"), config.recordings)
        estimators = [each.name for each in selection.estimators if each.manifest.status == "complete"]
        made += behind.write_recordings(watched, estimators, out, recorder, progress)
    return made


def _write(contents: report.Contents, out: Path, progress: Progress) -> None:
    for directory in (out / "figures", out / "tables"):
        directory.mkdir(exist_ok=True)
    tables.write_all(out / "tables", contents.answers, contents.derived.tables)
    with progress.task("figures", total=len(contents.drawn.every)) as task:
        for figure in contents.drawn.every:
            export.write(figure, out / "figures")
            task.advance()
    cameras.write(contents.cameras, out / "figures")
    evidence.write(contents, out)
    write_bytes(report.render(contents).encode(), out / "report.html")


def _summary(contents: report.Contents) -> dict[str, Any]:
    return {
        "runs": len(contents.selection.runs),
        "report": "report.html",
        "recordings": [recording.file for recording in contents.recordings if recording.error is None],
        "estimator_error": max(estimator_errors(contents.answers).values(), default=None),
        "results": [_result(group) for group in contents.derived.groups],
    }


def _result(group: Group) -> dict[str, Any]:
    return {
        "name": group.name,
        "task": group.task,
        "scheme": group.scheme,
        "misalignment_kind": group.misalignment_kind,
        "misalignment_deg": group.misalignment_deg,
        "seeds": len(group.seeds),
        "return_mean": None if group.returns is None else group.returns.mean,
        "return_std": None if group.returns is None else group.returns.std,
        "success_mean": None if group.success is None else group.success.mean,
    }
