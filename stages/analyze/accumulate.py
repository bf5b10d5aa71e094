"""Evidence of several sittings: what an earlier one says of runs whose logs are elsewhere is kept beside what is new.

How their answers become one is `stages.analyze.sittings`; everything else follows from the answers.
"""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
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
from stages.analyze.resolved import INPUTS, shared
from stages.analyze.results import Answer, rows_of
from stages.analyze.sittings import ABOUT, together, told_apart, without


def accumulate(earlier: Path, later: Path, out: Path) -> None:
    """Write into `out`, which is empty, the evidence in `earlier` and `later` as one; where both know, `later` counts.

    Raises:
        ArtifactError: `earlier` cannot be read.
        ConfigError: they do not fit together: `earlier` is of an older version, what their runs descend from has
            another configuration by the same name, or the seeds of one group are split between them.
    """
    (before, old), (now, new) = read_earlier(earlier), _read(later)
    _check_descent(before, now)
    check_runs(*([run["run"] for run in rows_of(each, "runs")] for each in (old, new)))
    old = without(old, rows_of(new, "runs"))
    new = told_apart(old, new)
    told = records.together(before, now)
    _write(out, told, together(old, new, told.asked), (earlier, later))


def read_earlier(directory: Path) -> tuple[Provenance, dict[str, Answer]]:
    """The evidence in `directory`, to which something can be added.

    Raises:
        ArtifactError: it cannot be read.
        ConfigError: it is of an older version.
    """
    told, answers = _read(directory)
    _check_version(directory, answers)
    return told, answers


def check_runs(earlier: Iterable[str], later: Iterable[str]) -> None:
    """A group's means are over its seeds, so those of one group have to be analysed together.

    Raises:
        ConfigError: `later` has some of the `earlier` runs NAME/CELL that differ in nothing but the seed, not all.
    """
    there, here = _seeds(earlier), _seeds(later)
    for group in there.keys() & here.keys():
        if missing := there[group] - here[group]:
            raise ConfigError(
                f"of {group} the earlier evidence has runs that are not among those of now "
                f"({', '.join(sorted(missing))}): the seeds of one group have to be analysed together"
            )


def _seeds(runs: Iterable[str]) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for run in runs:
        found.setdefault(run.rpartition("-seed")[0], set()).add(run)
    return found


def _read(directory: Path) -> tuple[Provenance, dict[str, Answer]]:
    try:
        _inputs(directory)
        return evidence.read_told(directory), tables.read_answers(directory / "tables")
    except (ValueError, OSError) as error:  # of JSON, TOML and Parquet too
        reason = str(error).splitlines()[0]
        raise ArtifactError(
            f"the evidence in {directory} cannot be read ({reason}): restore it, or remove it"
        ) from error


def _check_version(directory: Path, answers: Mapping[str, Answer]) -> None:
    for name in answers:
        if name not in ABOUT or any(key not in row for row in rows_of(answers, name)[:1] for key in ABOUT[name]):
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
    runs = records.ids_of_runs(now.artifacts)
    configs = {record.id: record.config_sha256 for record in records.without(before.artifacts, runs)}
    for record in (record for record in now.artifacts if record.id not in runs):
        if configs.get(record.id, record.config_sha256) != record.config_sha256:
            raise ConfigError(
                f"{record.id} was made by another configuration than the one that the earlier evidence has by this "
                "name: give one of them another name, with --name"
            )


def _inputs(directory: Path) -> dict[str, Any]:
    """The sections of its config.toml of what the runs descend from."""
    config = tomllib.loads((directory / evidence.CONFIG).read_text(encoding="utf-8"))
    return {name: config[name] for name in INPUTS if name in config}


def _write(out: Path, told: Provenance, answers: dict[str, Answer], sources: Sequence[Path]) -> None:
    """The evidence of `answers`; of pictures the last of `sources`, of inputs' configuration what is alike in all."""
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
    found = [_inputs(source) for source in sources]
    inputs = {name: shared([each[name] for each in found if name in each]) for each in found for name in each}
    evidence.write_told(told.model_copy(update={"figures": shown}), answers, derived, inputs, out)
