"""What one analysis looks at: the artifacts, and the answers to every question asked of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb

from schemas.errors import ArtifactError, ConfigError
from schemas.progress import Progress, Silent, Task
from stages.analyze import endings, questions, region_questions, study_questions
from stages.analyze.catalogue import Artifact, artifacts, select
from stages.analyze.query import query
from stages.analyze.results import Answer, Row
from stages.analyze.studies import Study
from stages.analyze.views import connect

_OF_RUNS = {
    "outcomes": questions.OUTCOMES,
    "learning-curves": questions.LEARNING_CURVES,
    "learning-area": questions.LEARNING_AREA,
    "switches": questions.SWITCHES,
    "switch-effect": questions.SWITCH_EFFECT,
    "reward-error": questions.REWARD_ERROR,
    "endings": endings.ENDINGS,
    "regions": region_questions.REGIONS,
    "region-correlation": region_questions.REGION_CORRELATION,
    "volume": questions.VOLUME,
}
_OF_ESTIMATORS = {
    "estimators": questions.ESTIMATORS,
    "estimator-epochs": questions.EPOCHS,
    "estimator-misalignment": questions.MISALIGNMENT,
}
_OF_EVERY = {"runs": questions.RUNS, "episodes-behind": questions.EPISODES_BEHIND}


@dataclass(frozen=True)
class Selection:
    """The artifacts of one analysis, and all the datasets and estimators they may descend from."""

    runs: list[Artifact]
    estimators: list[Artifact]
    sources: dict[str, Artifact]  # every dataset and estimator under the data root, by id
    studies: tuple[Study, ...]
    study_runs: list[Artifact]  # those of `studies` that are not in `runs`
    blanks: dict[str, str]  # of the questions, in SQL

    @property
    def every_run(self) -> list[Artifact]:
        """The runs and those of the studies beside them."""
        return [*self.runs, *self.study_runs]

    @property
    def datasets(self) -> list[Artifact]:
        """Those that the estimators were trained on, as far as they are still there."""
        inputs = dict.fromkeys(reference.id for each in self.estimators for reference in each.manifest.inputs)
        return [self.sources[id] for id in inputs if id in self.sources]


def choose(data_root: Path, runs: Sequence[str], estimators: Sequence[str], studies: Sequence[Study] = ()) -> Selection:
    """The artifacts named and the estimators that the runs named used; everything there is when nothing is named.

    Raises:
        ArtifactError: a name that no artifact has, or nothing there to analyse.
    """
    every_run, every_estimator = artifacts(data_root, "runs"), artifacts(data_root, "estimators")
    of_studies = select(every_run, [name for study in studies for name in study.runs])
    if not runs and not estimators:
        beside = {run.id for run in of_studies}
        chosen, made = [run for run in every_run if run.id not in beside], every_estimator
    else:
        chosen = select(every_run, runs)
        used = {str(run.manifest.config.get("estimator")) for run in [*chosen, *of_studies]}
        named = {artifact.name for artifact in select(every_estimator, estimators)}
        made = [artifact for artifact in every_estimator if artifact.name in used | named]
    if not chosen and not made:
        raise ArtifactError("nothing to analyse: no run and no estimator under the data root; train some first")
    main = {run.id for run in chosen}
    return Selection(
        runs=chosen,
        estimators=made,
        sources={artifact.id: artifact for artifact in [*artifacts(data_root, "datasets"), *every_estimator]},
        studies=tuple(studies),
        study_runs=[run for run in of_studies if run.id not in main],
        blanks=_blanks(chosen, of_studies, made, every_run, studies),
    )


def _blanks(
    chosen: Sequence[Artifact],
    of_studies: Sequence[Artifact],
    estimators: Sequence[Artifact],
    every_run: Sequence[Artifact],
    studies: Sequence[Study],
) -> dict[str, str]:
    main = questions.named(chosen, every_run)
    return {
        "main": main,
        "every": f"({main} OR {questions.named(of_studies, every_run)})" if of_studies else main,
        "runs": questions.logged(main),
        "estimators": questions.which_estimators(estimators),
        "members": study_questions.members(studies),
    }


def ask_all(data_root: Path, selection: Selection, progress: Progress) -> dict[str, Answer]:
    """Every question of the report that the selection has something to say about, by name.

    The logs of the studies are large and only their episodes are asked for: the other questions do not see them.
    """
    of_main, of_studies = (_filled(texts, selection.blanks) for texts in _questions(selection))
    main = [*selection.runs, *selection.estimators]
    with progress.task("queries", total=len(of_main) + len(of_studies)) as task:
        answers = _answers(data_root, main, of_main, task)
        return answers | _answers(data_root, selection.every_run, of_studies, task)


def ask(data_root: Path, runs: Sequence[Artifact], names: Sequence[str]) -> dict[str, Answer]:
    """Some of the report's questions, by name, asked of these runs alone."""
    main = questions.named(runs, artifacts(data_root, "runs"))
    blanks = {"main": main, "every": main, "runs": questions.logged(main)}
    texts = {name: (_OF_RUNS | _OF_EVERY)[name] for name in names}
    with Silent().task("queries", len(names)) as task:
        return _answers(data_root, runs, _filled(texts, blanks), task)


def _questions(selection: Selection) -> tuple[dict[str, str], dict[str, str]]:
    """Questions about the main artifacts, and those that concern the studies too."""
    of_main = (_OF_RUNS if selection.runs else {}) | (_OF_ESTIMATORS if selection.estimators else {})
    of_every = _OF_EVERY if selection.every_run else {}
    return of_main, of_every | ({"study-outcomes": study_questions.STUDY_OUTCOMES} if selection.studies else {})


def _filled(texts: dict[str, str], blanks: dict[str, str]) -> dict[str, str]:
    return {name: text.format(**blanks).strip() + "\n" for name, text in texts.items()}


def _answers(data_root: Path, seen: Sequence[Artifact], texts: dict[str, str], task: Task) -> dict[str, Answer]:
    answers = {}
    with connect(data_root, only=seen, threads=1) as connection:
        for name, sql in texts.items():
            task.note(name)
            answers[name] = Answer(sql, _ask(connection, sql))
            task.advance()
    return answers


def _ask(connection: duckdb.DuckDBPyConnection, sql: str) -> list[Row]:
    """Rows of one of our own questions, which only damaged logs can make fail."""
    try:
        return query(connection, sql).read_all().to_pylist()
    except (ConfigError, duckdb.Error, OSError) as error:
        raise ArtifactError(f"the logs cannot be read: {error}") from None
