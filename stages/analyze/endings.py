"""How the final episodes end: whether the task is done at the last step, and where that is lost."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stages.analyze.results import IDENTITY, Row, order

MEANINGS = {
    "kept": "done at the last step and in at least 19 of 20 steps since it first was",
    "regained": "done at the last step, with longer gaps",
    "lost": "done at some step, not at the last",
    "never": "done at no step",
    "fallen": "the cube is off the table at the end: more than 5 cm below where it began",
}
"""Of every ending, in the order of the tables."""

ENDINGS = """
-- how each run's final episodes end, by whether the task is done at the last step (reach: touch or 3 cm; lift: lifted):
-- kept (and done in 19 of 20 steps since it first was), regained, lost, never; fallen: the cube is off the table
WITH episode AS (
    SELECT run, task, misalignment_kind, misalignment_deg, scheme, seed, episode, sum(reward_dense_true) AS return,
           arg_max(success, step) AS is_done, count(*) FILTER (WHERE success) AS done,
           min(step) FILTER (WHERE success) AS first_done, max(step) AS last_step,
           arg_max(cube_true_z, step) - arg_min(cube_true_z, step) AS rise
    FROM transitions
    WHERE split = 'final' AND {runs}
    GROUP BY ALL
)
SELECT run, split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, seed,
       CASE WHEN rise < -0.05 THEN 'fallen'
            WHEN done = 0 THEN 'never'
            WHEN NOT is_done THEN 'lost'
            WHEN done >= 0.95 * (last_step + 1 - first_done) THEN 'kept'
            ELSE 'regained' END AS ending,
       count(*) AS episodes, avg(return) AS mean_return, avg(first_done + 1) AS mean_steps_to_success
FROM episode
GROUP BY ALL
ORDER BY run, ending
"""


@dataclass(frozen=True)
class Ending:
    """The episodes of a group that end in one way."""

    share: float
    mean_return: float | None  # None where there is no such episode


@dataclass(frozen=True)
class Endings:
    """How the final episodes of a group end, those of all seeds together."""

    name: str
    task: str
    misalignment_kind: str
    misalignment_deg: float
    scheme: str
    episodes: int
    endings: dict[str, Ending]  # by every key of `MEANINGS`


def pooled(rows: Sequence[Row]) -> list[Endings]:
    """Rows of the answer to `ENDINGS` by group: reach before lift, little misalignment before much."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in IDENTITY), []).append(row)
    made = [_of_group(key, members) for key, members in groups.items()]
    return sorted(made, key=order)


def _of_group(identity: tuple[Any, ...], rows: Sequence[Row]) -> Endings:
    name, task, kind, degrees, scheme = identity
    episodes = sum(row["episodes"] for row in rows)
    endings = {ending: _of([row for row in rows if row["ending"] == ending], episodes) for ending in MEANINGS}
    return Endings(name, task, kind, float(degrees or 0.0), scheme, episodes, endings)


def _of(rows: Sequence[Row], every: int) -> Ending:
    episodes = sum(row["episodes"] for row in rows)
    earned = sum(row["episodes"] * row["mean_return"] for row in rows)
    return Ending(episodes / every, earned / episodes if episodes else None)
