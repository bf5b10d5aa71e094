"""The episodes behind the points of the figures: which of them are recorded, and which recording a point leads to."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from schemas.errors import PipelineError
from schemas.progress import Progress
from stages.analyze.results import IDENTITY, LEARN_FROM_ESTIMATES, SCHEMES, Row

_SETTING = IDENTITY[:-1]  # without the scheme


class Recorder(Protocol):
    """Writes Rerun recordings. Injected: it needs the simulator."""

    def episode(self, run: str, split: str, episode: int, file: Path) -> object:
        """Of one logged episode."""

    def estimator(self, name: str, file: Path) -> object:
        """Of an estimator's worst, median and best test frames."""


@dataclass(frozen=True)
class Watched:
    """An episode worth watching, and why."""

    label: str  # best | worst | typical | worst-estimate
    run: str
    split: str
    episode: int
    group: tuple[object, ...]  # values of IDENTITY
    note: str

    @property
    def file(self) -> str:
        """Name of its recording."""
        return f"{self.label}-{self.run.replace('/', '-')}-{self.split}-{self.episode:06d}.rrd"


@dataclass(frozen=True)
class Recording:
    """A recording beside the report, or why there is none."""

    file: str
    note: str
    error: str | None = None
    of: Watched | str | None = None  # an episode, or an estimator by its name


class Links:
    """Where the points of the figures lead: names of files beside the report, None where nothing was recorded."""

    def __init__(self, made: Sequence[Recording]) -> None:
        whole = [each for each in made if each.error is None]
        self._episodes = [(each.of, each.file) for each in whole if isinstance(each.of, Watched)]
        self._estimators = {each.of: each.file for each in whole if isinstance(each.of, str)}

    def of_run(self, run: str) -> str | None:
        """The run's typical episode, else another one of it."""
        mine = [(each, file) for each, file in self._episodes if each.run == run]
        return _first(file for _, file in sorted(mine, key=lambda pair: pair[0].label != "typical"))

    def of_group(self, row: Row) -> str | None:
        """The typical episode of the runs that share all of `IDENTITY` with `row`."""
        group = tuple(row[key] for key in IDENTITY)
        return _first(file for each, file in self._episodes if each.label == "typical" and each.group == group)

    def of_setting(self, row: Row) -> str | None:
        """The same of the first scheme that acts on estimates, of a row that is about all of them."""
        schemes = (scheme for scheme in SCHEMES if scheme != "oracle")
        return _first(filter(None, (self.of_group({**row, "scheme": scheme}) for scheme in schemes)))

    def of_region(self, row: Row) -> str | None:
        """The episode with the worst estimate of a region of the table."""
        worst = (row["worst_run"], row["worst_episode"])
        return _first(
            file for each, file in self._episodes if (each.run, each.episode) == worst and each.split == "final"
        )

    def of_estimator(self, name: str) -> str | None:
        """The estimator's test frames."""
        return self._estimators.get(name)


def choose(episodes: Sequence[Row], regions: Sequence[Row], count: int) -> list[Watched]:
    """At most `count` episodes, each once, the most asked for first.

    The best and the worst of each task; of every group of the main runs the typical one, of median return in its
    median run; the ones behind the regions of the table with the worst estimates; the typical ones of the studies'
    variants; at last those of the other main runs. `episodes` and `regions` are answers to those questions.
    """
    typical = sorted((row for row in episodes if row["typical"]), key=_order)
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in typical:
        groups.setdefault(_group(row), []).append(row)
    medians = [_median(rows) for rows in groups.values()]
    main, variants = ([row for row in medians if row["main"] == is_main] for is_main in (True, False))
    others = [row for row in typical if row["main"]]  # of the studies no figure shows single runs
    of_groups = [*_typical(main), *_worst_estimates(regions), *_typical(variants)]
    wanted = [*_extremes(episodes), *of_groups, *_typical(others)]
    picked: dict[tuple[str, str, int], Watched] = {}
    for each in wanted:
        picked.setdefault((each.run, each.split, each.episode), each)
    return list(picked.values())[:count]


def _extremes(episodes: Sequence[Row]) -> list[Watched]:
    shown = sorted((row for row in episodes if row["main"]), key=lambda row: row["task"] != "reach")
    return [_watched(label, row) for row in shown for label in ("best", "worst") if row[label]]


def _typical(rows: Iterable[Row]) -> list[Watched]:
    return [_watched("typical", row) for row in rows]


def _worst_estimates(regions: Sequence[Row]) -> list[Watched]:
    """Of each group the episode behind its worst region."""
    known = [row for row in regions if row["worst_run"] is not None and row["scheme"] in LEARN_FROM_ESTIMATES]
    worst: dict[tuple[object, ...], Row] = {}
    for row in sorted(known, key=lambda row: -row["estimation_error"]):
        worst.setdefault(_group(row), row)
    return [_worst_estimate(row) for row in sorted(worst.values(), key=_order)]


def _worst_estimate(row: Row) -> Watched:
    run, episode, error = row["worst_run"], row["worst_episode"], 100 * row["worst_error"]
    note = f"worst estimate of {row['task']}: {run}, final episode {episode}, on average {error:.1f} cm off"
    return Watched("worst-estimate", run, "final", episode, _group(row), note)


def _watched(label: str, row: Row) -> Watched:
    run, split, episode = row["run"], row["split"], row["episode"]
    outcome = "success" if row["success"] else "no success"
    note = (
        f"{label} of {row['task']}: {run}, {split} episode {episode}, reward {row['return_dense_true']:.1f}, {outcome}"
    )
    return Watched(label, run, split, episode, _group(row), note)


def _group(row: Row) -> tuple[object, ...]:
    return tuple(row[key] for key in IDENTITY)


def _order(row: Row) -> tuple[object, ...]:
    """The main matrix first, reach first, then as in every table."""
    scheme = SCHEMES.index(row["scheme"]) if row["scheme"] in SCHEMES else len(SCHEMES)
    setting = (row[key] for key in _SETTING)
    return not row.get("main", True), row["task"] != "reach", *setting, scheme, row.get("run", "")


def _median(rows: list[Row]) -> Row:
    return sorted(rows, key=lambda row: row["return_dense_true"])[(len(rows) - 1) // 2]


def write_recordings(
    watched: Sequence[Watched], estimators: Sequence[str], out: Path, record: Recorder, progress: Progress
) -> list[Recording]:
    """Record the episodes, and the test frames of estimators. What this machine cannot record is noted, not fatal."""
    made = []
    with progress.task("recordings", total=len(estimators) + len(watched)) as task:
        for name in estimators:
            note = f"worst, median and best test frames of the estimator {name}"
            planned = Recording(f"estimator-{name}.rrd", note, of=name)
            made.append(_written(planned, out, partial(record.estimator, name)))
            task.advance()
        for each in watched:
            planned = Recording(each.file, each.note, of=each)
            made.append(_written(planned, out, partial(record.episode, each.run, each.split, each.episode)))
            task.advance()
    return made


def _written(planned: Recording, out: Path, write: Callable[[Path], object]) -> Recording:
    try:
        write(out / planned.file)
    except PipelineError as error:
        return replace(planned, error=str(error))
    return planned


def _first(found: Iterable[str]) -> str | None:
    return next(iter(found), None)
