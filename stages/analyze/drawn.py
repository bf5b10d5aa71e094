"""Every figure of a report, drawn from its answers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from stages.analyze.behind import Links
from stages.analyze.derived import Derived
from stages.analyze.figures import estimator, policy, regions
from stages.analyze.figures import studies as study_figures
from stages.analyze.figures.figure import Figure
from stages.analyze.results import Answer, Row, rows_of
from stages.analyze.studies import Study


@dataclass(frozen=True)
class Drawn:
    """The figures by what they are about."""

    estimator: list[Figure]
    curves: list[Figure]
    success: list[Figure]
    errors: list[Figure]
    regions: list[Figure]
    studies: list[Figure]

    @property
    def every(self) -> list[Figure]:
        """All of them, in the order of the page."""
        return [*self.estimator, *self.curves, *self.success, *self.errors, *self.regions, *self.studies]


def draw(answers: Mapping[str, Answer], derived: Derived, asked: Sequence[Study], links: Links) -> Drawn:
    """The figures that `answers` have something for; `links` say where their points lead."""
    return Drawn(
        estimator=_estimator(answers, links),
        curves=_by_task(answers, "learning-curves", _curves(answers, links)),
        success=_by_task(answers, "outcomes", partial(policy.success, links)),
        errors=_reward_error(answers, links),
        regions=_by_task(answers, "regions", partial(regions.regions, links)),
        studies=_studies(answers, derived, asked, links),
    )


def _estimator(answers: Mapping[str, Answer], links: Links) -> list[Figure]:
    makers = {
        "estimator-epochs": estimator.estimator_epochs,
        "estimator-misalignment": estimator.estimator_misalignment,
    }
    asked = {name: answers[name] for name in makers if rows_of(answers, name)}
    return [makers[name](links, answer.rows, answer.sql) for name, answer in asked.items()]


def _by_task(
    answers: Mapping[str, Answer], name: str, make: Callable[[str, list[Row], str], Figure | None]
) -> list[Figure]:
    rows = rows_of(answers, name)
    tasks = sorted({row["task"] for row in rows}, key=lambda task: (task != "reach", task))
    made = [make(task, [row for row in rows if row["task"] == task], answers[name].sql) for task in tasks]
    return [figure for figure in made if figure is not None]


def _curves(answers: Mapping[str, Answer], links: Links) -> Callable[[str, list[Row], str], Figure]:
    def make(task: str, rows: list[Row], sql: str) -> Figure:
        switches = [row for row in rows_of(answers, "switches") if row["task"] == task]
        return policy.learning_curves(links, task, rows, switches, sql)

    return make


def _reward_error(answers: Mapping[str, Answer], links: Links) -> list[Figure]:
    rows = rows_of(answers, "reward-error")
    return [policy.reward_error(links, rows, answers["reward-error"].sql)] if rows else []


def _studies(answers: Mapping[str, Answer], derived: Derived, asked: Sequence[Study], links: Links) -> list[Figure]:
    made = []
    for study in asked:
        mine = [each for each in derived.variants if each.study == study.name]
        made.append(study_figures.study(links, study, mine, answers["study-outcomes"].sql))
    return [figure for figure in made if figure is not None]
