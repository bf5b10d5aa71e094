"""Rerun recordings beside the report: learning curves of all runs, and the episodes worth watching."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from rerun_blueprints.comparison import comparison
from schemas.entities import APPLICATION_ID, TRAINING_EPISODE, curve
from schemas.errors import PipelineError
from stages.analyze.figures.theme import COLOURS
from stages.analyze.results import Row, misalignment

COMPARISON_FILE = "comparison.rrd"
TYPICAL = "typical"

RecordEpisode = Callable[[str, str, int, Path], None]
"""(run, split, episode, file): write one logged episode as a Rerun recording. Injected; it needs the simulator."""


@dataclass(frozen=True)
class Recording:
    """A recording beside the report, or why there is none."""

    file: str
    note: str
    error: str | None = None
    run: str | None = None  # whose episode it shows


def write_comparison(curves: Sequence[Row], path: Path) -> Recording:
    """Mean and one standard deviation either side, over the training episodes, one view a task and misalignment."""
    series: dict[tuple[str, str], list[Row]] = defaultdict(list)
    several = len({row["name"] for row in curves}) > 1
    for row in sorted(curves, key=lambda row: row["task"] != "reach"):
        series[_panel(row, several), row["scheme"]].append(row)
    panels = list(dict.fromkeys(panel for panel, _ in series))
    with rr.RecordingStream(APPLICATION_ID, recording_id="comparison") as stream:
        stream.save(path, default_blueprint=comparison(panels))
        for (panel, scheme), rows in series.items():
            _log_series(stream, panel, scheme, rows)
        stream.flush()
        stream.disconnect()
    return Recording(path.name, "learning curves of all schemes")


def _panel(row: Row, several: bool) -> str:
    setting = f"{row['task']} {misalignment(row['misalignment_kind'], row['misalignment_deg'])}"
    return f"{setting} {row['name']}" if several else setting


def _log_series(stream: rr.RecordingStream, panel: str, scheme: str, rows: list[Row]) -> None:
    episodes = [rr.TimeColumn(TRAINING_EPISODE, sequence=[row["after_episode"] for row in rows])]
    mean = np.array([row["mean"] for row in rows])  # (n,)
    std = np.array([row["std"] or 0.0 for row in rows])
    colour = _rgb(COLOURS.get(scheme, COLOURS["oracle"]))
    parts = {"mean": mean[:, None]} | ({"spread": np.stack([mean - std, mean + std], axis=1)} if std.any() else {})
    for part, values in parts.items():  # (n, lines)
        width, lines = 2.5 if part == "mean" else 0.7, values.shape[1]
        style = rr.SeriesLines(colors=[colour] * lines, widths=[width] * lines, names=[scheme] * lines)
        stream.log(curve(panel, scheme, part), style, static=True)
        stream.send_columns(curve(panel, scheme, part), episodes, rr.Scalars.columns(scalars=values))


def _rgb(colour: str) -> list[int]:
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


def links(made: Sequence[Recording]) -> dict[str, str]:
    """The recording behind each run's point in a figure: its typical episode, else another one of it."""
    whole = [each for each in made if each.run is not None and each.error is None]
    return {str(each.run): each.file for each in sorted(whole, key=lambda each: each.file.startswith(TYPICAL))}


def write_episodes(rows: Sequence[Row], count: int, out: Path, record: RecordEpisode) -> list[Recording]:
    """Record `count` episodes: the best and the worst, then every run's typical one, then the next best and worst.

    One that this machine cannot record is noted, not fatal.
    """
    return [_write_episode(label, row, out, record) for label, row in _pick(rows, count)]


def _pick(rows: Sequence[Row], count: int) -> list[tuple[str, Row]]:
    best = sorted(rows, key=lambda row: (row["best"], row["task"] != "reach"))
    worst = sorted(rows, key=lambda row: (row["worst"], row["task"] != "reach"))
    extremes = [pair for good, bad in zip(best, worst, strict=True) for pair in (("best", good), ("worst", bad))]
    typical = [(TYPICAL, row) for row in sorted(rows, key=lambda row: str(row["run"])) if row["typical"]]
    picked: dict[tuple[str, str, int], tuple[str, Row]] = {}
    for label, row in [*extremes[:2], *typical, *extremes[2:]]:
        picked.setdefault((row["run"], row["split"], row["episode"]), (label, row))
    return list(picked.values())[:count]


def _write_episode(label: str, row: Row, out: Path, record: RecordEpisode) -> Recording:
    run, split, episode = row["run"], row["split"], row["episode"]
    file = f"{label}-{run.replace('/', '-')}-{split}-{episode:06d}.rrd"
    outcome = "success" if row["success"] else "no success"
    note = (
        f"{label} of {row['task']}: {run}, {split} episode {episode}, reward {row['return_dense_true']:.1f}, {outcome}"
    )
    try:
        record(run, split, episode, out / file)
    except PipelineError as error:
        return Recording(file, note, str(error), run)
    return Recording(file, note, run=run)
