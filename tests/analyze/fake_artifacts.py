"""Datasets, estimators and manifests as the stages would write them, of random numbers."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from schemas import tables
from schemas.files import write_parquet
from schemas.manifest import Code, Environment, FileRef, InputRef, Manifest, config_sha256

MACHINE = Environment(
    python="3.11.9",
    platform="Linux-6.1-x86_64",
    cpu="Imaginary 9000 (2 cores)",
    gpu=None,
    gl_renderer="llvmpipe",
    packages={"torch": "2.13.0", "mujoco": "3.9.1", "numpy": "2.4.2"},
)


def table(rows: list[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """`rows` under `schema`; columns that a row does not name are null."""
    columns = [pa.array([row.get(field.name) for row in rows], _plain(field.type)) for field in schema]
    return pa.table(columns, names=schema.names).cast(schema)


def _plain(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_dictionary(kind) else kind


def write_manifest(
    directory: Path,
    id: str,
    config: dict[str, Any],
    summary: dict[str, Any],
    status: str = "complete",
    inputs: dict[str, Path] | None = None,
    **changes: Any,
) -> None:
    """A manifest that lists the Parquet files there are, unless `changes` says otherwise."""
    files = [] if status == "running" else [_reference(directory, path) for path in directory.rglob("*.parquet")]
    stage = {"datasets": "collect", "estimators": "train-perception", "runs": "train-policy"}[id.split("/")[0]]
    fields: dict[str, Any] = {
        "id": id,
        "stage": stage,
        "name": id.split("/")[1],
        "status": status,
        "created_at": "2026-01-02T03:04:05+00:00",
        "config": config,
        "config_sha256": config_sha256(config),
        "inputs": [InputRef(id=key, manifest_sha256=manifest_sha256(path)) for key, path in (inputs or {}).items()],
        "code": Code(version="0.1.0", git_commit="0123456789abcdef", dirty=False),
        "environment": MACHINE,
        "files": files,
        "summary": summary,
    }
    (directory / "manifest.json").write_text(Manifest(**(fields | changes)).model_dump_json())


def _reference(directory: Path, path: Path) -> FileRef:
    data = path.read_bytes()
    name = path.relative_to(directory).as_posix()
    return FileRef(path=name, bytes=len(data), sha256=hashlib.sha256(data).hexdigest())


def manifest_sha256(directory: Path) -> str:
    """Hash of the manifest in `directory`."""
    return hashlib.sha256((directory / "manifest.json").read_bytes()).hexdigest()


def write_dataset(root: Path, name: str = "fixed-camera") -> Path:
    """A dataset of two frames."""
    directory = root / "datasets" / name
    directory.mkdir(parents=True)
    rows = [
        {"dataset": name, "episode": i, "step": 4, "time_ns": 200_000_000, "split": split, "cube_x": 0.1 * i}
        for i, split in enumerate(("train", "test"))
    ]
    write_parquet(table(rows, tables.FRAMES), directory / "frames.parquet")
    write_manifest(directory, f"datasets/{name}", {}, {"episodes": 2, "frames": 2, "bytes": 12345})
    return directory


def write_estimator(
    root: Path,
    name: str = "resnet",
    epochs: int = 30,
    dataset: Path | None = None,
    error: float = 0.0152,
    config: dict[str, Any] | None = None,
) -> Path:
    """An estimator whose error falls with every epoch, and rises when the camera is turned."""
    rng = np.random.default_rng(1)
    directory = root / "estimators" / name
    directory.mkdir(parents=True)
    write_parquet(table(_epoch_rows(name, epochs, rng), tables.EPOCHS), directory / "epochs.parquet")
    rows = [
        {"estimator": name, "misalignment_kind": kind, "misalignment_deg": deg, "split": "test", "error": error}
        for kind, deg, scale in (("none", 0, 1.5), ("pan", 5, 6), ("pan", 10, 11), ("orbit", 5, 2.4), ("orbit", 10, 4))
        for error in scale / 100 * rng.gamma(4.0, 0.25, size=200)
    ]
    write_parquet(table(rows, tables.PREDICTIONS), directory / "predictions.parquet")
    summary = {"test_mean_error": error, "test_median_error": 0.0131, "test_p95_error": 0.031, "epochs": epochs}
    inputs = {f"datasets/{dataset.name}": dataset} if dataset else {}
    write_manifest(directory, f"estimators/{name}", config or {}, summary, inputs=inputs)
    return directory


def _epoch_rows(name: str, epochs: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    return [
        {
            "estimator": name,
            "epoch": epoch,
            "split": split,
            "mean_error": (floor + 0.12 * np.exp(-epoch / 6)) * rng.uniform(0.95, 1.05),
        }
        for epoch in range(1, epochs + 1)
        for split, floor in (("train", 0.006), ("validation", 0.0148))
    ]
