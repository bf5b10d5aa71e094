"""The analysis: logs in, one report with its figures, tables, evidence and recordings out."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from schemas.files import write_bytes
from schemas.progress import Progress
from stages.analyze import behind, curves_recording, evidence, report, results, tables
from stages.analyze.behind import Links, Recorder, Recording
from stages.analyze.config import AnalyzeConfig
from stages.analyze.derived import Derived, derive, estimator_errors
from stages.analyze.figures import cameras, estimator, export, policy, regions
from stages.analyze.figures import studies as study_figures
from stages.analyze.figures.figure import Figure
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
    links = Links(recorded)
    contents = report.Contents(
        config=config,
        selection=selection,
        answers=answers,
        derived=derived,
        estimator_figures=_estimator_figures(answers, links),
        curve_figures=_by_task(answers, "learning-curves", _curves(answers, links)),
        success_figures=_by_task(answers, "outcomes", partial(policy.success, links)),
        error_figures=_reward_error(answers, links),
        region_figures=_by_task(answers, "regions", partial(regions.regions, links)),
        study_figures=_studies(selection, answers, derived, links),
        recordings=recorded,
        cameras=cameras.pictures(out / "figures"),
        left_out=left_out,
    )
    _write(contents, out, progress)
    return _summary(contents)


def _estimator_figures(answers: dict[str, Answer], links: Links) -> list[Figure]:
    makers = {
        "estimator-epochs": estimator.estimator_epochs,
        "estimator-misalignment": estimator.estimator_misalignment,
    }
    asked = {name: answers[name] for name in makers if rows_of(answers, name)}
    return [makers[name](links, answer.rows, answer.sql) for name, answer in asked.items()]


def _by_task(
    answers: dict[str, Answer], name: str, make: Callable[[str, list[results.Row], str], Figure | None]
) -> list[Figure]:
    rows = rows_of(answers, name)
    tasks = sorted({row["task"] for row in rows}, key=lambda task: (task != "reach", task))
    made = [make(task, [row for row in rows if row["task"] == task], answers[name].sql) for task in tasks]
    return [figure for figure in made if figure is not None]


def _curves(answers: dict[str, Answer], links: Links) -> Callable[[str, list[results.Row], str], Figure]:
    def make(task: str, rows: list[results.Row], sql: str) -> Figure:
        switches = [row for row in rows_of(answers, "switches") if row["task"] == task]
        return policy.learning_curves(links, task, rows, switches, sql)

    return make


def _reward_error(answers: dict[str, Answer], links: Links) -> list[Figure]:
    rows = rows_of(answers, "reward-error")
    return [policy.reward_error(links, rows, answers["reward-error"].sql)] if rows else []


def _studies(selection: Selection, answers: dict[str, Answer], derived: Derived, links: Links) -> list[Figure]:
    made = []
    for study in selection.studies:
        mine = [each for each in derived.variants if each.study == study.name]
        made.append(study_figures.study(links, study, mine, answers["study-outcomes"].sql))
    return [figure for figure in made if figure is not None]


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
    with progress.task("figures", total=len(contents.figures)) as task:
        for figure in contents.figures:
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
