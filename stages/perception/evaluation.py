"""The test: recorded frames, and the same states seen from a camera that was turned after training (SPEC §3, §4)."""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa

from schemas.datasets import FrameRef, Rerender
from schemas.errors import ArtifactError
from schemas.files import write_parquet
from schemas.progress import Progress, Task
from schemas.tables import PREDICTIONS
from stages.perception.dataset import Frames
from stages.perception.estimator import Estimator
from stages.perception.metrics import ErrorSummary, euclidean_errors, summarise

MISALIGNMENTS = ("pan", "orbit")
_BATCH = 64


def evaluate(
    estimator: Estimator,
    frames: Frames,
    degrees: Iterable[float],
    name: str,
    rerender: Rerender,
    out: Path,
    progress: Progress,
) -> tuple[ErrorSummary, dict[str, float]]:
    """Test `estimator` on the test split, as recorded and misaligned, and write predictions.parquet into `out`.

    Returns the errors on recorded frames, and the mean error [m] of each misalignment by name ("pan05").
    """
    rows = frames.indices("test")
    refs = [frames.refs[row] for row in rows]
    true = frames.positions[rows]  # (n, 3)
    cases = [(kind, angle) for kind in MISALIGNMENTS for angle in degrees]
    with progress.task("test estimator", len(rows) * (1 + len(cases))) as task:
        estimated = _predict(estimator, (frames.images[row] for row in rows), len(rows), task)
        recorded = summarise(true, estimated)
        task.note(f"test {100 * recorded.mean_error:.2f} cm")
        tables = [_table(name, "none", 0.0, refs, true, estimated)]
        misaligned = {}
        for kind, angle in cases:
            estimated = _predict(estimator, rerender(refs, kind, angle), len(rows), task)
            tables.append(_table(name, kind, angle, refs, true, estimated))
            misaligned[f"{kind}{angle:02g}"] = summarise(true, estimated).mean_error
    write_parquet(pa.concat_tables(tables).unify_dictionaries(), out / "predictions.parquet")
    return recorded, misaligned


def _predict(estimator: Estimator, images: Iterable[np.ndarray], count: int, task: Task) -> np.ndarray:
    """Estimates (count, 3) for images that may be rendered as they are asked for."""
    estimates = []
    stream: Iterator[np.ndarray] = iter(images)
    while batch := list(islice(stream, _BATCH)):
        estimates.append(estimator.predict(np.stack(batch)))
        task.advance(len(batch))
    estimated = np.concatenate(estimates)
    if len(estimated) != count:
        raise ArtifactError(f"re-rendering gave {len(estimated)} images for {count} test frames; is the dataset whole?")
    return estimated


def _table(
    name: str, kind: str, degrees: float, refs: list[FrameRef], true: np.ndarray, estimated: np.ndarray
) -> pa.Table:
    count = len(refs)
    columns = {
        "estimator": [name] * count,
        "misalignment_kind": [kind] * count,
        "misalignment_deg": np.full(count, degrees, np.float32),
        "split": ["test"] * count,
        "episode": [ref.episode for ref in refs],
        "step": [ref.step for ref in refs],
        **{f"cube_true_{axis}": true[:, i].astype(np.float32) for i, axis in enumerate("xyz")},
        **{f"cube_est_{axis}": estimated[:, i].astype(np.float32) for i, axis in enumerate("xyz")},
        "error": euclidean_errors(true, estimated).astype(np.float32),
    }
    return pa.table(columns, schema=PREDICTIONS)
