"""The analysis: logs in, one report with its figures, tables and recordings out."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from schemas.files import write_bytes
from schemas.progress import Progress
from stages.analyze import recordings, report, results, tables
from stages.analyze.catalogue import Artifact
from stages.analyze.config import AnalyzeConfig
from stages.analyze.figures import estimator, export, policy
from stages.analyze.figures.figure import Figure
from stages.analyze.recordings import RecordEpisode, Recording
from stages.analyze.results import Group, Statistics
from stages.analyze.study import Answer, ask_all, choose


def run(
    config: AnalyzeConfig,
    data_root: Path,
    runs: Sequence[str],
    estimators: Sequence[str],
    out: Path,
    *,
    record_episode: RecordEpisode | None,
    progress: Progress,
) -> dict[str, Any]:
    """Write report.html, figures/, tables/ and recordings into `out`; returns the summary for the manifest.

    `runs` are NAMEs or NAME/CELL, `estimators` NAMEs; with neither, everything under `data_root` is analysed.

    Raises:
        ArtifactError: an unknown name, nothing to analyse, or logs that cannot be read.
    """
    selection = choose(data_root, runs, estimators)
    answers = ask_all(data_root, selection, config.recordings, progress)
    statistics = Statistics(config)
    groups = results.groups(selection.runs, _rows(answers, "outcomes"), statistics)
    contents = report.Contents(
        config=config,
        selection=selection,
        answers=answers,
        groups=groups,
        switches=results.switches(_rows(answers, "switch-effect"), statistics),
        comparisons=results.beside_paper(groups),
        estimator_figures=_estimator_figures(answers),
        curve_figures=_by_task(answers, "learning-curves", _curves(answers)),
        success_figures=_by_task(answers, "outcomes", policy.success),
        error_figures=_reward_error(answers),
        recordings=_record(config, answers, out, record_episode, progress),
        cameras=sorted((out / "figures").glob("camera-*.png"), key=_camera_order),
    )
    _write(contents, out, progress)
    return _summary(contents)


def _camera_order(picture: Path) -> tuple[str, float]:
    """By kind of misalignment and angle: `camera-0°`, `camera-orbit 5°`, `camera-orbit 10°`, …"""
    kind, _, angle = picture.stem.removeprefix("camera-").rpartition(" ")
    digits = angle.rstrip("°")
    return kind, float(digits) if digits.replace(".", "").isdigit() else 0.0


def _rows(answers: dict[str, Answer], name: str) -> list[results.Row]:
    return answers[name].rows if name in answers else []


def _estimator_figures(answers: dict[str, Answer]) -> list[Figure]:
    makers = {
        "estimator-epochs": estimator.estimator_epochs,
        "estimator-misalignment": estimator.estimator_misalignment,
    }
    return [make(answers[name].rows, answers[name].sql) for name, make in makers.items() if _rows(answers, name)]


def _by_task(
    answers: dict[str, Answer], name: str, make: Callable[[str, list[results.Row], str], Figure]
) -> list[Figure]:
    rows = _rows(answers, name)
    tasks = sorted({row["task"] for row in rows}, key=lambda task: (task != "reach", task))
    return [make(task, [row for row in rows if row["task"] == task], answers[name].sql) for task in tasks]


def _curves(answers: dict[str, Answer]) -> Callable[[str, list[results.Row], str], Figure]:
    def make(task: str, rows: list[results.Row], sql: str) -> Figure:
        switches = [row for row in _rows(answers, "switches") if row["task"] == task]
        return policy.learning_curves(task, rows, switches, sql)

    return make


def _reward_error(answers: dict[str, Answer]) -> list[Figure]:
    rows = _rows(answers, "reward-error")
    return [policy.reward_error(rows, answers["reward-error"].sql)] if rows else []


def _record(
    config: AnalyzeConfig, answers: dict[str, Answer], out: Path, record: RecordEpisode | None, progress: Progress
) -> list[Recording]:
    made = []
    curves = _rows(answers, "learning-curves")
    if curves:
        made.append(recordings.write_comparison(curves, out / recordings.COMPARISON_FILE))
    if record is not None and config.recordings:
        episodes = _rows(answers, "extreme-episodes")
        with progress.task("recordings", total=config.recordings) as task:
            made += recordings.write_episodes(episodes, config.recordings, out, record)
            task.advance(config.recordings)
    return made


def _write(contents: report.Contents, out: Path, progress: Progress) -> None:
    for directory in (out / "figures", out / "tables"):
        directory.mkdir(exist_ok=True)
    tables.write_all(out / "tables", contents.answers, contents.groups, contents.comparisons)
    with progress.task("figures", total=len(contents.figures)) as task:
        for figure in contents.figures:
            export.write(figure, out / "figures")
            task.advance()
    write_bytes(report.render(contents).encode(), out / "report.html")


def _summary(contents: report.Contents) -> dict[str, Any]:
    return {
        "runs": len(contents.selection.runs),
        "report": "report.html",
        "recordings": [recording.file for recording in contents.recordings if recording.error is None],
        "estimator_error": _estimator_error(contents.selection.estimators),
        "results": [_result(group) for group in contents.groups],
    }


def _estimator_error(estimators: Sequence[Artifact]) -> float | None:
    """Smallest mean test error [m] of the estimators that have one."""
    errors = [artifact.manifest.summary.get("test_mean_error") for artifact in estimators]
    return min((float(error) for error in errors if error is not None), default=None)


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
