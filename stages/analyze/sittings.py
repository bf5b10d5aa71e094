"""The answers of several sittings as those of one: pure functions of their rows.

Answers are about a run, or about the runs that differ in nothing but the seed, so those of different runs stand beside
each other. What compares runs of different schemes step by step or episode by episode (lost return, the effect of the
switch beside `dense`) is there for those that were analysed together.

An estimator that was made anew, by the same configuration on another machine, is another one: it is told apart by a
number after its name.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import chain, count
from typing import Any

from stages.analyze.results import IDENTITY, Answer, Row, rows_of
from stages.analyze.studies import Study

_RUN, _SETTING, _ESTIMATOR = ("run",), IDENTITY[:-1], ("estimator",)
ABOUT = {
    "runs": _RUN,
    "outcomes": _RUN,
    "learning-area": _RUN,
    "volume": _RUN,
    "episodes-behind": _RUN,
    "learning-curves": IDENTITY,
    "switch-effect": IDENTITY,
    "endings": IDENTITY,
    "regions": IDENTITY,
    "region-correlation": IDENTITY,
    "reward-error": IDENTITY,
    "switches": _SETTING,
    "estimators": _ESTIMATOR,
    "estimator-epochs": _ESTIMATOR,
    "estimator-misalignment": _ESTIMATOR,
    "study-outcomes": ("study", "run"),
}
"""What the rows of an answer are about, by its name: rows about the same are replaced by newer ones."""
_BESIDE = {"switches": "dense2sparse", "switch-effect": "dense2sparse", "region-correlation": "oracle"}
"""Answers that are also about another scheme than the one that their rows name."""
_PLACE = ("task", "scheme", "misalignment_kind", "misalignment_deg")  # of a study's run and the main one beside it
_OF_RUN = ("run", "name", *_PLACE, "seed", "status", "main", "config")
_OF_END = (
    *("split", "after_episode", "episodes", "mean_return", "success_rate"),
    *("mean_steps_to_success", "mean_estimation_error"),
)


def without(answers: Mapping[str, Answer], runs: Sequence[Row]) -> dict[str, Answer]:
    """Nothing of what `runs`, which were made anew, had said: also where they say nothing now, for they failed.

    Nor of estimators that no other run has.
    """
    every = rows_of(answers, "runs")
    names = {run["run"] for run in runs}
    gone = {run["estimator"] for run in every if run["run"] in names}
    gone -= {run["estimator"] for run in every if run["run"] not in names}
    settings = {key_of(run, IDENTITY) for run in runs}
    kept = {}
    for name, answer in answers.items():
        rows = [row for row in answer.rows if not _is_of(name, row, names, settings)]
        rows = [row for row in rows if ABOUT[name] != _ESTIMATOR or row["estimator"] not in gone]
        kept[name] = Answer(answer.sql, [_without_oracle(name, row, settings) for row in rows])
    return kept


def _is_of(name: str, row: Row, runs: set[str], settings: set[tuple[Any, ...]]) -> bool:
    """Whether a row of this answer is about one of the runs or settings."""
    if "run" in row:
        return row["run"] in runs
    about = [row] if "scheme" in row else []
    if name in _BESIDE:
        about.append(row | {"scheme": _BESIDE[name]})
    return any(key_of(each, IDENTITY) in settings for each in about)


def _without_oracle(name: str, row: Row, settings: set[tuple[Any, ...]]) -> Row:
    """A region's row; without what was lost against an oracle that is another one now."""
    replaced = name == "regions" and key_of(row | {"scheme": "oracle"}, IDENTITY) in settings
    return row | {"compared": 0, "lost_return": None} if replaced else row


def together(old: Mapping[str, Answer], new: Mapping[str, Answer], asked: Sequence[Study]) -> dict[str, Answer]:
    """The answers of both; where both have rows about the same, those in `new`."""
    answers = {}
    for name in dict.fromkeys([*new, *old]):
        rows = _union(rows_of(old, name), rows_of(new, name), ABOUT[name])
        answers[name] = Answer((new.get(name) or old[name]).sql, rows)
    if "episodes-behind" in answers:
        answers["episodes-behind"] = _one_extreme(answers["episodes-behind"])
    if "study-outcomes" in answers:
        answers["study-outcomes"] = _beside_main(answers, asked)
    return answers


def _union(old: Sequence[Row], new: Sequence[Row], about: Sequence[str]) -> list[Row]:
    """Rows of both, ordered by what they are about; all with the columns of both."""
    known = {key_of(row, about) for row in new}
    kept = [row for row in old if key_of(row, about) not in known]
    columns = dict.fromkeys(column for row in [*new[:1], *kept[:1]] for column in row)
    rows = [{column: row.get(column) for column in columns} for row in [*kept, *new]]
    return sorted(rows, key=lambda row: key_of(row, about))


def key_of(row: Row, about: Sequence[str]) -> tuple[Any, ...]:
    """The row's values of these columns."""
    return tuple(row[key] for key in about)


def _one_extreme(answer: Answer) -> Answer:
    """Of the best of several sittings the best, and of the worst the worst."""
    rows = [dict(row) for row in answer.rows]
    for flag, sign in (("best", 1), ("worst", -1)):
        for task in {row["task"] for row in rows}:
            flagged = [row for row in rows if row["task"] == task and row[flag]]
            for row in sorted(flagged, key=lambda row: sign * row["return_dense_true"])[:-1]:
                row[flag] = False
    return Answer(answer.sql, [row for row in rows if row["best"] or row["worst"] or row["typical"]])


def _beside_main(answers: Mapping[str, Answer], asked: Sequence[Study]) -> Answer:
    """The studies' runs with the main ones of the same settings, which another sitting may have made."""
    varied = [row for row in answers["study-outcomes"].rows if not row["main"]]
    settings = {(row["study"], *key_of(row, _PLACE)) for row in varied}
    ends = {row["run"]: row for row in rows_of(answers, "outcomes")}
    beside = [
        {"study": study.name, **_picked(run, _OF_RUN), **_picked(ends.get(run["run"], {}), _OF_END)}
        for study in asked
        for run in rows_of(answers, "runs")
        if run["name"] == study.main and (study.name, *key_of(run, _PLACE)) in settings
    ]
    estimators = {run["run"]: run["estimator"] for run in rows_of(answers, "runs")}
    rows = [_with_estimator(row, estimators[row["run"]]) for row in [*varied, *beside]]
    ordered = sorted(rows, key=lambda row: (row["study"], row["main"], row["run"]))
    return Answer(answers["study-outcomes"].sql, ordered)


def _with_estimator(row: Row, label: str | None) -> Row:
    """A study's row whose configuration names the estimator as it is told apart, so that a difference is seen."""
    config = json.loads(row["config"])
    return row if config.get("estimator") == label else row | {"config": json.dumps(config | {"estimator": label})}


def _picked(row: Row, keys: Sequence[str]) -> Row:
    return {key: row.get(key) for key in keys}


def told_apart(old: Mapping[str, Answer], new: Mapping[str, Answer]) -> dict[str, Answer]:
    """The answers in `new`, estimators that are not those in `old` by the same name with a number after it."""
    known = {row["estimator"]: row for row in rows_of(old, "estimators")}
    labels = {row["estimator"]: _label(row, known) for row in rows_of(new, "estimators")}
    return {name: Answer(answer.sql, [_relabelled(row, labels) for row in answer.rows]) for name, answer in new.items()}


def _label(estimator: Row, known: Mapping[str, Row]) -> str:
    """The one by which it is known, else `laptop`, or `laptop (2)` where that is another one."""
    name = str(estimator["estimator"])
    mine = {label: row for label, row in known.items() if label == name or label.startswith(f"{name} (")}
    same = [label for label, row in mine.items() if row | {"estimator": name} == estimator]
    free = (label for label in chain([name], (f"{name} ({number})" for number in count(2))) if label not in mine)
    return next(chain(same, free))


def _relabelled(row: Row, labels: Mapping[str, str]) -> Row:
    return row | {"estimator": labels.get(row["estimator"], row["estimator"])} if "estimator" in row else row
