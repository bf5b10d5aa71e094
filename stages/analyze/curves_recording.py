"""The Rerun recording of learning curves."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
import rerun as rr

from rerun_blueprints.comparison import comparison
from rerun_blueprints.whole_file import recorded
from schemas.entities import APPLICATION_ID, TRAINING_EPISODE, curve
from schemas.errors import MachineError
from stages.analyze.behind import Recording
from stages.analyze.figures.theme import COLOURS, MORE_SERIES, SERIES
from stages.analyze.results import Row, misalignment

COMPARISON_FILE = "comparison.rrd"


def write_comparison(curves: Sequence[Row], path: Path) -> Recording:
    """Mean and one standard deviation either side, over the training episodes, one view a task and misalignment.

    Runs of several NAMEs are side by side in a view.

    Raises:
        MachineError: it cannot be written.
    """
    series: dict[tuple[str, str], list[Row]] = defaultdict(list)
    several = len({row["name"] for row in curves}) > 1
    for row in sorted(curves, key=lambda row: row["task"] != "reach"):
        panel = f"{row['task']} {misalignment(row['misalignment_kind'], row['misalignment_deg'])}"
        series[panel, f"{row['name']} {row['scheme']}" if several else row["scheme"]].append(row)
    panels, labels = (list(dict.fromkeys(key[part] for key in series)) for part in (0, 1))
    colours = dict(zip(labels, cycle(SERIES + MORE_SERIES), strict=False)) if several else COLOURS
    stream = rr.RecordingStream(APPLICATION_ID, recording_id="comparison")
    try:
        with recorded(stream, path, comparison(panels)):
            for (panel, label), rows in series.items():
                _log_series(stream, panel, label, _rgb(colours.get(label, COLOURS["oracle"])), rows)
    except OSError as error:
        raise MachineError(f"cannot write {path}: {error.strerror or error}; mend that, then try again") from error
    return Recording(path.name, "learning curves of all schemes")


def _log_series(stream: rr.RecordingStream, panel: str, label: str, colour: list[int], rows: list[Row]) -> None:
    episodes = [rr.TimeColumn(TRAINING_EPISODE, sequence=[row["after_episode"] for row in rows])]
    mean = np.array([row["mean"] for row in rows])  # (n,)
    std = np.array([row["std"] or 0.0 for row in rows])
    parts = {"mean": mean[:, None]} | ({"spread": np.stack([mean - std, mean + std], axis=1)} if std.any() else {})
    for part, values in parts.items():  # (n, lines)
        width, lines = 2.5 if part == "mean" else 0.7, values.shape[1]
        style = rr.SeriesLines(colors=[colour] * lines, widths=[width] * lines, names=[label] * lines)
        stream.log(curve(panel, label, part), style, static=True)
        stream.send_columns(curve(panel, label, part), episodes, rr.Scalars.columns(scalars=values))


def _rgb(colour: str) -> list[int]:
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
