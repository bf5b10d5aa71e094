"""What must hold of an artifact whose writer was killed, and whether two artifacts are the same."""

import json
import re
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from safetensors import safe_open

from schemas.manifest import MANIFEST
from schemas.mcap_files import read_messages

_DONE = 10**15
_ENDED = _DONE - 1
_OWN = ("run", "dataset", "estimator", "wall_time_s", "seconds")
"""Columns that say which artifact it is, or how long something took."""


def published(directory: Path) -> list[Path]:
    """Files that readers see: not the hidden ones, which are being written."""
    paths = (path for path in sorted(directory.rglob("*")) if path.is_file())
    return [path for path in paths if not any(part.startswith(".") for part in path.relative_to(directory).parts)]


def unreadable(directory: Path) -> list[str]:
    """Published files that cannot be read to their end, and why."""
    found = []
    for path in published(directory):
        try:
            content(path)
        except Exception as error:  # whatever it is, a reader would meet it
            found.append(f"{path.relative_to(directory)}: {error}")
    return found


def content(path: Path) -> Any:
    """All of a file, comparable with `==`, without what is an artifact's own."""
    if path.suffix == ".parquet":
        return _table(path).to_pylist()
    if path.suffix == ".mcap":
        return [(topic, time, message.SerializeToString()) for topic, time, message in read_messages(path)]
    if path.suffix == ".safetensors":
        with safe_open(path, "np") as stored:
            return {key: stored.get_tensor(key).tobytes() for key in sorted(stored.keys())}
    return json.loads(path.read_bytes())


def _table(path: Path) -> pa.Table:
    table = pq.read_table(path, partitioning=None)
    return table.drop_columns([name for name in _OWN if name in table.column_names])


def different(whole: Path, other: Path) -> list[str]:
    """Files of results that are not the same in two finished artifacts."""
    kinds = (".parquet", ".mcap", ".safetensors")
    one, two = (
        {path.relative_to(root).as_posix(): path for path in published(root) if path.suffix in kinds}
        for root in (whole, other)
    )
    both = sorted(one.keys() & two.keys())
    return sorted(one.keys() ^ two.keys()) + [name for name in both if not _same(one[name], two[name])]


def _same(one: Path, other: Path) -> bool:
    return repr(content(one)) == repr(content(other))  # as text, for NaN is not itself


def progress(directory: Path) -> int:
    """How far an artifact is: its episode files, its newest checkpoint, or its end, which its manifest tells of last.

    Where the work has ended there is no checkpoint; where there is one again, the work was begun again.
    """
    if (directory / MANIFEST).exists() and content(directory / MANIFEST).get("status") == "complete":
        return _DONE
    if (directory / "episodes").is_dir():
        return len(list((directory / "episodes").glob("*.mcap")))
    names = [path.name for path in directory.glob("checkpoints/[0-9e]*")]
    found = (re.fullmatch(r"(\d{6})-(\d{6})|epoch-(\d{6})-\w+\.safetensors", name) for name in names)
    reached = [int("".join(each.groups(""))) for each in found if each]
    has_ended = any((directory / name).exists() for name in ("estimator.json", "checkpoints/policy.json"))
    return max(reached, default=_ENDED if has_ended else 0)
