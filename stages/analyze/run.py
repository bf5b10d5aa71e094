"""The analysis: logs in, one report with its figures, tables, evidence and recordings out."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from schemas.files import write_bytes
from schemas.progress import Progress
from stages.analyze import evidence, recordings, report, results, tables
from stages.analyze.config import AnalyzeConfig
from stages.analyze.derived import Derived, derive, estimator_errors
from stages.analyze.figures import cameras, estimator, export, policy, regions
from stages.analyze.figures import studies as study_figures
from stages.analyze.figures.figure import Figure
from stages.analyze.recordings import RecordEpisode, Recording
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
    record_episode: RecordEpisode | None,
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
    answers = ask_all(data_root, selection, config.recordings, progress)
    derived = derive(config, selection.studies, answers)
    recorded = _record(config, answers, out, record_episode, progress)
    contents = report.Contents(
        config=config,
        selection=selection,
        answers=answers,
        derived=derived,
        estimator_figures=_estimator_figures(answers),
        curve_figures=_by_task(answers, "learning-curves", _curves(answers)),
        success_figures=_by_task(answers, "outcomes", partial(policy.success, recordings.links(recorded))),
        error_figures=_reward_error(answers),
        region_figures=_by_task(answers, "regions", regions.regions),
        study_figures=_studies(selection, answers, derived),
        recordings=recorded,
        cameras=cameras.pictures(out / "figures"),
        left_out=left_out,
    )
    _write(contents, out, progress)
    return _summary(contents)


def _estimator_figures(answers: dict[str, Answer]) -> list[Figure]:
    makers = {
        "estimator-epochs": estimator.estimator_epochs,
        "estimator-misalignment": estimator.estimator_misalignment,
    }
    return [make(answers[name].rows, answers[name].sql) for name, make in makers.items() if rows_of(answers, name)]


def _by_task(
    answers: dict[str, Answer], name: str, make: Callable[[str, list[results.Row], str], Figure | None]
) -> list[Figure]:
    rows = rows_of(answers, name)
    tasks = sorted({row["task"] for row in rows}, key=lambda task: (task != "reach", task))
    made = [make(task, [row for row in rows if row["task"] == task], answers[name].sql) for task in tasks]
    return [figure for figure in made if figure is not None]


def _curves(answers: dict[str, Answer]) -> Callable[[str, list[results.Row], str], Figure]:
    def make(task: str, rows: list[results.Row], sql: str) -> Figure:
        switches = [row for row in rows_of(answers, "switches") if row["task"] == task]
        return policy.learning_curves(task, rows, switches, sql)

    return make


def _reward_error(answers: dict[str, Answer]) -> list[Figure]:
    rows = rows_of(answers, "reward-error")
    return [policy.reward_error(rows, answers["reward-error"].sql)] if rows else []


def _studies(selection: Selection, answers: dict[str, Answer], derived: Derived) -> list[Figure]:
    made = []
    for study in selection.studies:
        mine = [each for each in derived.variants if each.study == study.name]
        made.append(study_figures.study(study, mine, answers["study-outcomes"].sql))
    return [figure for figure in made if figure is not None]


def _record(
    config: AnalyzeConfig, answers: dict[str, Answer], out: Path, record: RecordEpisode | None, progress: Progress
) -> list[Recording]:
    made = []
    curves = rows_of(answers, "learning-curves")
    if curves:
        made.append(recordings.write_comparison(curves, out / recordings.COMPARISON_FILE))
    if record is not None and config.recordings:
        episodes = rows_of(answers, "extreme-episodes")
        with progress.task("recordings", total=config.recordings) as task:
            made += recordings.write_episodes(episodes, config.recordings, out, record)
            task.advance(config.recordings)
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
