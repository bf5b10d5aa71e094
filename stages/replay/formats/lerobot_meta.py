"""How LeRobot is told what is in its files: Arrow types, features and tasks."""

import json
from typing import Any

import numpy as np
import pyarrow as pa

from stages.replay.formats.episodes import INSTRUCTIONS
from stages.replay.formats.lerobot_files import CODEC, pixel_format
from stages.sim.scene import CONTROL_FREQUENCY


def table(columns: dict[str, np.ndarray]) -> pa.Table:
    """Columns (n,) or (n, d) as LeRobot's Parquet files have them."""
    return pa.table({name: _array(values) for name, values in columns.items()})


def _array(values: np.ndarray) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def features(columns: dict[str, np.ndarray], videos: dict[str, np.ndarray]) -> dict[str, dict[str, Any]]:
    """Type and shape of every column (n,) or (n, d), and of every video (n, H, W, 3)."""
    found: dict[str, dict[str, Any]] = {
        name: {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": None}
        for name, values in columns.items()
    }
    return found | {name: _video_feature(*frames.shape[1:]) for name, frames in videos.items()}


def _video_feature(height: int, width: int, channels: int) -> dict[str, Any]:
    about = {
        "video.height": height,
        "video.width": width,
        "video.codec": CODEC,
        "video.pix_fmt": pixel_format(height, width),
        "video.is_depth_map": False,
        "video.fps": CONTROL_FREQUENCY,
        "video.channels": channels,
        "has_audio": False,
    }
    names = ["height", "width", "channels"]
    return {"dtype": "video", "shape": [height, width, channels], "names": names, "info": about}


def task_table(tasks: list[str]) -> pa.Table:
    """Instructions of the tasks as the index of a pandas table, which LeRobot reads them as."""
    columns = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    described = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}
        for name, kind, stored in columns
    ]
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": described}
    made = pa.table({"task_index": np.arange(len(tasks)), "task": [INSTRUCTIONS[task] for task in tasks]})
    return made.replace_schema_metadata({"pandas": json.dumps(pandas)})
