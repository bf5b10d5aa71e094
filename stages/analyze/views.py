"""The SQL views of SPEC §6, on a DuckDB connection that can read the data root and nothing else."""

import json
import os
import tempfile
import weakref
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from schemas import tables
from schemas.errors import ArtifactError
from stages.analyze import macros
from stages.analyze.catalogue import Artifact, artifacts, check_files
from stages.analyze.pinned import Pinned, by_name
from stages.analyze.sql_text import literal

_IDENTITY = [("task", pa.string()), ("scheme", pa.string()), ("misalignment_kind", pa.string())]
_COMMON = [
    ("status", pa.string()),  # running | complete | failed
    ("created_at", pa.timestamp("us")),  # UTC
]
_PROVENANCE = [
    ("config", pa.string()),  # JSON: config->>'$.policy.switch_episode'
    ("config_sha256", pa.string()),
    ("manifest_sha256", pa.string()),
    ("schema_version", pa.int32()),
]

RUNS = pa.schema(
    [
        ("run", pa.string()),  # NAME/CELL
        ("name", pa.string()),
        ("cell", pa.string()),
        *_IDENTITY,
        ("misalignment_deg", pa.float32()),
        ("seed", pa.int32()),
        *_COMMON,
        ("estimator", pa.string()),
        ("episodes", pa.int32()),  # of training
        ("global_steps", pa.int64()),
        ("final_return", pa.float64()),
        ("final_success_rate", pa.float64()),
        ("best_eval_return", pa.float64()),
        ("estimation_error", pa.float64()),
        ("steps_per_second", pa.float64()),
        ("wall_time_s", pa.float64()),
        *_PROVENANCE,
    ]
)
RELABELS = pa.schema(
    [
        ("relabel", pa.string()),  # NAME/CELL
        ("source", pa.string()),  # the run
        *_IDENTITY,
        ("misalignment_deg", pa.float32()),
        ("seed", pa.int32()),
        *_COMMON,
        ("estimator", pa.string()),
        ("transitions", pa.int64()),
        ("mean_reward_used", pa.float64()),
        ("estimation_error", pa.float64()),
        *_PROVENANCE,
    ]
)
DATASETS = pa.schema(
    [
        ("dataset", pa.string()),
        *_COMMON,
        ("episodes", pa.int32()),
        ("frames", pa.int64()),
        ("bytes", pa.int64()),
        *_PROVENANCE,
    ]
)
ESTIMATORS = pa.schema(
    [
        ("estimator", pa.string()),
        *_COMMON,
        ("dataset", pa.string()),
        ("epochs", pa.int32()),
        ("parameters", pa.int64()),
        ("test_mean_error", pa.float64()),
        ("test_median_error", pa.float64()),
        ("test_p95_error", pa.float64()),
        *_PROVENANCE,
    ]
)

_MANIFEST_VIEWS = {"runs": RUNS, "relabels": RELABELS, "datasets": DATASETS, "estimators": ESTIMATORS}
_FILE_VIEWS: dict[str, tuple[str, str, pa.Schema]] = {  # view: kind of artifact, files, schema
    "episodes": ("runs", "episodes.parquet", tables.EPISODES),
    "transitions": ("runs", "transitions/part-*.parquet", tables.transitions(1, 1)),
    "evaluations": ("runs", "evaluations.parquet", tables.EVALUATIONS),
    "updates": ("runs", "updates.parquet", tables.UPDATES),
    "relabelled_episodes": ("relabels", "episodes.parquet", tables.EPISODES),
    "relabelled_transitions": ("relabels", "transitions/part-*.parquet", tables.transitions(1, 1)),
    "frames": ("datasets", "frames.parquet", tables.FRAMES),
    "epochs": ("estimators", "epochs.parquet", tables.EPOCHS),
    "predictions": ("estimators", "predictions.parquet", tables.PREDICTIONS),
}
_RELABELLED = ("relabelled_episodes", "relabelled_transitions")
"""Views whose column `run` is called `relabel`: it is no run's name."""
VIEWS = (*_MANIFEST_VIEWS, *_FILE_VIEWS)
_LOGGED = ("complete", "running")
"""Statuses whose files are in the views (SPEC §6): a failed run is listed in `runs`, its logs are in no average."""


def connect(
    data_root: Path, only: Sequence[Artifact] | None = None, *, threads: int | None = None
) -> duckdb.DuckDBPyConnection:
    """An in-memory database with the views over all artifacts under `data_root`, or over those in `only`.

    It reads files below `data_root` only, installs and loads nothing, and its settings are locked. What it may be
    asked is up to `stages.analyze.guard`, since DuckDB has no setting against `COPY … TO` below an allowed directory.
    With one of `threads` every sum is taken in the same order, so that its answers are the same bits each time.

    Raises:
        ArtifactError: an artifact's files are missing, damaged, or of another schema version.
    """
    found = list(only) if only is not None else [a for kind in _MANIFEST_VIEWS for a in artifacts(data_root, kind)]  # type: ignore[arg-type]
    for artifact in found:
        check_files(artifact)
    connection = duckdb.connect(config=_settings() | ({"threads": threads} if threads else {}))
    for view, schema in _MANIFEST_VIEWS.items():
        rows = [_row(artifact, schema) for artifact in found if artifact.kind == view]
        _create_table(connection, view, pa.Table.from_pylist(rows, schema=schema))
    pinned = Pinned()
    weakref.finalize(connection, pinned.close)
    for view, (kind, pattern, schema) in _FILE_VIEWS.items():
        logged = [artifact for artifact in found if artifact.kind == kind and artifact.manifest.status in _LOGGED]
        _create_view(connection, view, [file for each in logged for file in _files(each, pattern, pinned)], schema)
    macros.define(connection)
    _confine(connection, [data_root.resolve(), *pinned.directories()])
    return connection


def _files(artifact: Artifact, pattern: str, pinned: Pinned) -> list[Path]:
    files = artifact.parquet(pattern)
    return pinned.names(files) if artifact.manifest.status == "running" else files


def _settings() -> dict[str, str | bool | int | float | list[str]]:
    return {
        "autoinstall_known_extensions": False,
        "autoload_known_extensions": False,
        "allow_community_extensions": False,
        "python_enable_replacements": False,  # SQL does not see Python's variables
        "temp_directory": str(Path(tempfile.gettempdir()) / f"pipeline-sql-{os.getpid()}"),  # where large sorts spill
        "memory_limit": "1GB",
    }


def _confine(connection: duckdb.DuckDBPyConnection, directories: Sequence[Path]) -> None:
    """From here on only files below these (links resolved) are readable, and no setting can be changed."""
    allowed = ", ".join(literal(str(directory)) for directory in directories)
    connection.execute(f"SET allowed_directories = [{allowed}]")
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")


def _create_table(connection: duckdb.DuckDBPyConnection, name: str, table: pa.Table) -> None:
    connection.register("incoming", table)
    connection.execute(f"CREATE TABLE {name} AS FROM incoming")
    connection.unregister("incoming")


def _create_view(connection: duckdb.DuckDBPyConnection, name: str, files: list[Path], schema: pa.Schema) -> None:
    if not files:
        empty = _plain(schema).empty_table()
        names = ["relabel" if column == "run" else column for column in schema.names]
        _create_table(connection, name, empty.rename_columns(names) if name in _RELABELLED else empty)
        return
    paths = ", ".join(literal(str(path)) for path in files)
    columns = ", ".join(schema.names)
    if name in _RELABELLED:
        columns = columns.replace("run", "run AS relabel", 1)
    try:
        connection.execute(f"CREATE VIEW {name} AS SELECT {columns} FROM read_parquet([{paths}])")
    except duckdb.Error as error:
        raise ArtifactError(f"cannot read the files of the view {name!r}: {by_name(str(error))}") from None


def _plain(schema: pa.Schema) -> pa.Schema:
    """The schema as DuckDB reads it back from Parquet: dictionaries as strings, lists of any length."""
    return pa.schema([pa.field(field.name, _plain_type(field.type)) for field in schema])


def _plain_type(kind: pa.DataType) -> pa.DataType:
    if pa.types.is_dictionary(kind):
        return kind.value_type
    if pa.types.is_fixed_size_list(kind):
        return pa.list_(kind.value_type)
    return kind


def _row(artifact: Artifact, schema: pa.Schema) -> dict[str, Any]:
    """One row of a manifest view; what the manifest does not (yet) say is null."""
    manifest = artifact.manifest
    name, _, cell = artifact.name.partition("/")
    known: dict[str, Any] = {
        artifact.kind.removesuffix("s"): artifact.name,
        "name": name,
        "cell": cell,
        "source": manifest.config.get("source"),
        "estimator": artifact.name if artifact.kind == "estimators" else manifest.config.get("estimator"),
        "status": manifest.status,
        "created_at": _utc(manifest.created_at),
        "config": json.dumps(manifest.config),
        "config_sha256": manifest.config_sha256,
        "manifest_sha256": artifact.manifest_sha256,
        "schema_version": manifest.schema_version,
    }
    if artifact.kind == "estimators":
        known["dataset"] = next((i.id.removeprefix("datasets/") for i in manifest.inputs), None)
    identity = manifest.config.get("run", {})
    values = {**manifest.summary, **identity, **known}
    return {field.name: _of_type(values.get(field.name), field.type) for field in schema}


def _of_type(value: Any, kind: pa.DataType) -> Any:
    """`value`, or None where a manifest holds something else than the column's type."""
    try:
        return pa.scalar(value, kind).as_py()
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
        return None


def _utc(text: str) -> datetime | None:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment.astimezone(UTC).replace(tzinfo=None) if moment.tzinfo else moment
