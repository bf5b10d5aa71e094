"""The Rerun recording of learning curves."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from rerun_blueprints.comparison import comparison
from schemas.entities import APPLICATION_ID, TRAINING_EPISODE, curve
from stages.analyze.behind import Recording
from stages.analyze.figures.theme import COLOURS
from stages.analyze.results import Row, misalignment

COMPARISON_FILE = "comparison.rrd"


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
