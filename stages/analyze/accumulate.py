"""Evidence of several sittings: what an earlier one says of runs whose logs are elsewhere is kept beside what is new.

Answers are about a run, or about the runs that differ in nothing but the seed, so those of different runs stand beside
each other; everything else follows from them. What compares runs of different schemes step by step or episode by
episode (lost return, the effect of the switch beside `dense`) is there for those that were analysed together.

An estimator that was made anew, by the same configuration on another machine, is another one: it is told apart by a
number after its name.
"""

import tomllib
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from shutil import copyfile
from typing import Any

from schemas.errors import ArtifactError, ConfigError
from stages.analyze import evidence, records, tables
from stages.analyze.behind import Links
from stages.analyze.derived import derive
from stages.analyze.drawn import draw
from stages.analyze.figures import cameras, export
from stages.analyze.records import Provenance
from stages.analyze.resolved import INPUTS
from stages.analyze.results import IDENTITY, Answer, Row, rows_of
from stages.analyze.studies import Study

_RUN, _SETTING, _ESTIMATOR = ("run",), IDENTITY[:-1], ("estimator",)
_ABOUT = {
    "runs": _RUN,
    "outcomes": _RUN,
    "learning-area": _RUN,
    "volume": _RUN,
    "episodes-behind": _RUN,
    "learning-curves": IDENTITY,
    "switch-effect": IDENTITY,
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
_PLACE = ("task", "scheme", "misalignment_kind", "misalignment_deg")  # of a study's run and the main one beside it
_OF_RUN = ("run", "name", *_PLACE, "seed", "status", "main", "config")
_OF_END = (
    *("split", "after_episode", "episodes", "mean_return", "success_rate"),
    *("mean_steps_to_success", "mean_estimation_error"),
)


def accumulate(earlier: Path, later: Path, out: Path) -> None:
    """Write into `out`, which is empty, the evidence in `earlier` and `later` as one; where both know, `later` counts.

    Raises:
        ArtifactError: `earlier` cannot be read.
        ConfigError: they do not fit together: `earlier` is of an older version, what their runs descend from has
            another configuration by the same name, or the seeds of one group are split between them.
    """
    (before, old), (now, new) = _read(earlier), _read(later)
    _check_version(earlier, old)
    _check_descent(before, now)
    new = _told_apart(old, new)
    _check_groups(rows_of(old, "runs"), rows_of(new, "runs"))
    told = records.together(before, now)
    _write(out, told, _together(old, new, told.asked), (earlier, later))


def _read(directory: Path) -> tuple[Provenance, dict[str, Answer]]:
    try:
        _inputs(directory)
        return evidence.read_told(directory), tables.read_answers(directory / "tables")
    except (ValueError, OSError) as error:  # of JSON, TOML and Parquet too
        reason = str(error).splitlines()[0]
        raise ArtifactError(
            f"the evidence in {directory} cannot be read ({reason}): restore it, or remove it"
        ) from error


def _together(old: Mapping[str, Answer], new: Mapping[str, Answer], asked: Sequence[Study]) -> dict[str, Answer]:
    answers = {}
    for name in dict.fromkeys([*new, *old]):
        rows = _union(rows_of(old, name), rows_of(new, name), _ABOUT[name])
        answers[name] = Answer((new.get(name) or old[name]).sql, rows)
    if "episodes-behind" in answers:
        answers["episodes-behind"] = _one_extreme(answers["episodes-behind"])
    if "study-outcomes" in answers:
        answers["study-outcomes"] = _beside_main(answers, asked)
    return answers


def _union(old: Sequence[Row], new: Sequence[Row], about: Sequence[str]) -> list[Row]:
    """Rows of both, ordered by what they are about."""
    known = {_key(row, about) for row in new}
    kept = [row for row in old if _key(row, about) not in known]
    return sorted([*kept, *new], key=lambda row: _key(row, about))


def _key(row: Row, about: Sequence[str]) -> tuple[Any, ...]:
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
    settings = {(row["study"], *_key(row, _PLACE)) for row in varied}
    ends = {row["run"]: row for row in rows_of(answers, "outcomes")}
    beside = [
        {"study": study.name, **_picked(run, _OF_RUN), **_picked(ends.get(run["run"], {}), _OF_END)}
        for study in asked
        for run in rows_of(answers, "runs")
        if run["name"] == study.main and (study.name, *_key(run, _PLACE)) in settings
    ]
    ordered = sorted([*varied, *beside], key=lambda row: (row["study"], row["main"], row["run"]))
    return Answer(answers["study-outcomes"].sql, ordered)


def _picked(row: Row, keys: Sequence[str]) -> Row:
    return {key: row.get(key) for key in keys}


def _check_version(directory: Path, answers: Mapping[str, Answer]) -> None:
    for name in answers:
        if name not in _ABOUT or any(key not in row for row in rows_of(answers, name)[:1] for key in _ABOUT[name]):
            raise _older(directory)
    if any("config" not in run for run in rows_of(answers, "runs")):
        raise _older(directory)


def _older(directory: Path) -> ConfigError:
    return ConfigError(
        f"{directory} is the evidence of another version, to which nothing can be added: choose another directory, or "
        "leave out --accumulate to replace it"
    )


def _check_descent(before: Provenance, now: Provenance) -> None:
    """Runs of several sittings are compared as if datasets and estimators of a name were made in the same way."""
    configs = {record.id: record.config_sha256 for record in before.artifacts if not record.id.startswith("runs/")}
    for record in now.artifacts:
        if configs.get(record.id, record.config_sha256) != record.config_sha256:
            raise ConfigError(
                f"{record.id} was made by another configuration than the one that the earlier evidence has by this "
                "name: give one of them another name, with --name"
            )


def _told_apart(old: Mapping[str, Answer], new: Mapping[str, Answer]) -> dict[str, Answer]:
    """The answers in `new`, estimators that are not those in `old` by the same name with a number after it."""
    known = {row["estimator"]: row for row in rows_of(old, "estimators")}
    labels = {row["estimator"]: _label(row, known) for row in rows_of(new, "estimators")}
    return {name: Answer(answer.sql, [_relabelled(row, labels) for row in answer.rows]) for name, answer in new.items()}


def _label(estimator: Row, known: Mapping[str, Row]) -> str:
    """`laptop`, or `laptop (2)` where that is another one."""
    name = str(estimator["estimator"])
    labels = chain([name], (f"{name} ({number})" for number in count(2)))
    return next(label for label in labels if label not in known or known[label] == estimator | {"estimator": label})


def _relabelled(row: Row, labels: Mapping[str, str]) -> Row:
    return row | {"estimator": labels.get(row["estimator"], row["estimator"])} if "estimator" in row else row


def _check_groups(old: Sequence[Row], new: Sequence[Row]) -> None:
    """A group's means are over its seeds, so those of one group have to be analysed together."""
    there, here = _seeds(old), _seeds(new)
    for group in there.keys() & here.keys():
        if missing := there[group] - here[group]:
            raise ConfigError(
                f"of {'/'.join(map(str, group))} the earlier evidence has runs that are not under this data root "
                f"({', '.join(sorted(missing))}): the seeds of one group have to be analysed together"
            )


def _seeds(runs: Sequence[Row]) -> dict[tuple[Any, ...], set[str]]:
    found: dict[tuple[Any, ...], set[str]] = {}
    for run in runs:
        if run["main"]:
            found.setdefault(_key(run, IDENTITY), set()).add(run["run"])
    return found


def _inputs(directory: Path) -> dict[str, Any]:
    """The sections of its config.toml of what the runs descend from."""
    config = tomllib.loads((directory / evidence.CONFIG).read_text(encoding="utf-8"))
    return {name: config[name] for name in INPUTS if name in config}


def _write(out: Path, told: Provenance, answers: dict[str, Answer], sources: Sequence[Path]) -> None:
    """The evidence of `answers`; of pictures and configuration's inputs those of the last of `sources`."""
    for directory in (out / "figures", out / "tables"):
        directory.mkdir(parents=True)
    derived = derive(told.analysis, told.asked, answers)
    figures = draw(answers, derived, told.asked, Links([])).every
    for figure in figures:
        export.write(figure, out / "figures")
    views = {view.name: view for source in sources for view in cameras.pictures(source / "figures")}
    for view in views.values():
        copyfile(view, out / "figures" / view.name)
    shown = records.shown(figures, cameras.pictures(out / "figures"))
    cameras.write(cameras.pictures(out / "figures"), out / "figures")
    tables.write_all(out / "tables", answers, derived.tables)
    inputs = {name: section for source in sources for name, section in _inputs(source).items()}
    evidence.write_told(told.model_copy(update={"figures": shown}), answers, derived, inputs, out)
