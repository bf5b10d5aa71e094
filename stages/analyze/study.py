"""What one analysis looks at: the artifacts, and the answers to every question asked of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb

from schemas.errors import ArtifactError, ConfigError
from schemas.progress import Progress
from stages.analyze import questions
from stages.analyze.catalogue import Artifact, artifacts, select
from stages.analyze.query import query
from stages.analyze.results import Row
from stages.analyze.views import connect


@dataclass(frozen=True)
class Selection:
    """The artifacts of one analysis, and all the datasets and estimators they may descend from."""

    runs: list[Artifact]
    estimators: list[Artifact]
    sources: dict[str, Artifact]  # every dataset and estimator under the data root, by id
    runs_condition: str  # SQL
    estimators_condition: str


@dataclass(frozen=True)
class Answer:
    """A question and its rows."""

    sql: str
    rows: list[Row]


def choose(data_root: Path, runs: Sequence[str], estimators: Sequence[str]) -> Selection:
    """The artifacts named and the estimators that the runs named used; everything there is when nothing is named.

    Raises:
        ArtifactError: a name that no artifact has, or nothing there to analyse.
    """
    every_run, every_estimator = artifacts(data_root, "runs"), artifacts(data_root, "estimators")
    if not runs and not estimators:
        chosen, made = every_run, every_estimator
    else:
        chosen = select(every_run, runs)
        used = {str(run.manifest.config.get("estimator")) for run in chosen}
        named = {artifact.name for artifact in select(every_estimator, estimators)}
        made = [artifact for artifact in every_estimator if artifact.name in used | named]
    if not chosen and not made:
        raise ArtifactError("nothing to analyse: no run and no estimator under the data root; train some first")
    sources = {artifact.id: artifact for artifact in [*artifacts(data_root, "datasets"), *every_estimator]}
    conditions = questions.which_runs(chosen, every_run), questions.which_estimators(made)
    return Selection(chosen, made, sources, *conditions)


def ask_all(data_root: Path, selection: Selection, recordings: int, progress: Progress) -> dict[str, Answer]:
    """Every question of the report that the selection has something to say about, by name."""
    texts = _texts(selection, recordings)
    with (
        connect(data_root, only=[*selection.runs, *selection.estimators]) as connection,
        progress.task("queries", total=len(texts)) as task,
    ):
        answers = {}
        for name, sql in texts.items():
            task.note(name)
            answers[name] = Answer(sql, _ask(connection, sql))
            task.advance()
    return answers


def _texts(selection: Selection, recordings: int) -> dict[str, str]:
    of_runs = {
        "outcomes": questions.OUTCOMES,
        "learning-curves": questions.LEARNING_CURVES,
        "switches": questions.SWITCHES,
        "switch-effect": questions.SWITCH_EFFECT,
        "reward-error": questions.REWARD_ERROR,
        "volume": questions.VOLUME,
        "extreme-episodes": questions.EXTREME_EPISODES,
    }
    of_estimators = {"estimator-epochs": questions.EPOCHS, "estimator-misalignment": questions.MISALIGNMENT}
    templates = (of_runs if selection.runs else {}) | (of_estimators if selection.estimators else {})
    blanks = {
        "runs": selection.runs_condition,
        "estimators": selection.estimators_condition,
        "count": str(max(1, recordings)),
    }
    return {name: template.format(**blanks).strip() + "\n" for name, template in templates.items()}


def _ask(connection: duckdb.DuckDBPyConnection, sql: str) -> list[Row]:
    """Rows of one of our own questions, which only damaged logs can make fail."""
    try:
        return query(connection, sql).read_all().to_pylist()
    except (ConfigError, duckdb.Error, OSError) as error:
        raise ArtifactError(f"the logs cannot be read: {error}") from None
