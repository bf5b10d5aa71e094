"""Worst, median and best test frames of an estimator."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import RrdReader

from schemas import entities
from schemas.errors import ArtifactError
from schemas.files import write_parquet
from schemas.tables import PREDICTIONS
from stages.replay.estimator_recording import record_estimator
from stages.replay.predictions import load_frames, load_predictions, select
from tests.replay.tiny_run import _manifest


@pytest.fixture
def estimator(tmp_path: Path) -> Path:
    """Errors of 0, 1, … 20 mm along x on the 21 frames of the tiny dataset, and twice that from another camera."""
    directory = tmp_path / "eye"
    directory.mkdir()
    rows = [_row("none", 0.0, step, step / 1000) for step in range(21)]
    rows += [_row("pan", 5.0, step, step / 500) for step in range(21)]
    write_parquet(pa.Table.from_pylist(rows, schema=PREDICTIONS), directory / "predictions.parquet")
    manifest = _manifest("reach") | {"id": "estimators/eye", "stage": "train-perception", "name": "eye"}
    (directory / "manifest.json").write_text(json.dumps(manifest))
    return directory


def _row(kind: str, degrees: float, step: int, error: float) -> dict[str, Any]:
    place = {"cube_true_x": 0.0, "cube_true_y": 0.1, "cube_true_z": 0.825}
    estimate = {"cube_est_x": error, "cube_est_y": 0.1, "cube_est_z": 0.825}
    case = {"estimator": "eye", "misalignment_kind": kind, "misalignment_deg": degrees, "split": "test"}
    return case | place | estimate | {"episode": 0, "step": step, "error": error}


def test_groups_are_the_worst_the_median_and_the_best():
    groups = select(np.arange(9.0), 2)
    assert {name: rows.tolist() for name, rows in groups.items()} == {
        "worst": [8, 7],
        "median": [5, 4],
        "best": [1, 0],
    }


@given(st.lists(st.floats(0, 1), min_size=1, max_size=60), st.integers(1, 15))
def test_no_frame_is_in_two_groups_and_errors_fall(error: list[float], count: int):
    rows = np.concatenate(list(select(np.array(error), count).values()))
    assert len(set(rows.tolist())) == len(rows) > 0
    assert (np.diff(np.array(error)[rows]) <= 0).all()
    assert rows[0] == np.argmax(error)


def test_means_are_by_misalignment_and_rows_as_recorded(estimator: Path):
    predictions, means = load_predictions(estimator)
    assert len(predictions) == 21
    assert means == {"as recorded": pytest.approx(0.010), "pan 5°": pytest.approx(0.020)}


def test_frames_come_in_the_order_asked_for(dataset_dir: Path):
    frames = load_frames(dataset_dir, np.array([0, 0]), np.array([7, 2]))
    assert frames[0].media_type == "image/png"
    assert frames[0].image != frames[1].image
    assert frames[0].intrinsics.size == 64
    assert np.isclose(frames[0].cube_position[2], 0.825, atol=1e-3)


def test_the_recording_shows_frames_from_the_worst_to_the_best(estimator: Path, dataset_dir: Path, tmp_path: Path):
    path = tmp_path / "test.rrd"
    assert record_estimator(estimator, dataset_dir, path) == 21
    reader = RrdReader(path)
    assert len(reader.blueprints()) == 1
    errors, groups = [], []
    for chunk in reader.stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entities.FRAME_ERROR and not chunk.is_static:
            errors += [value[0] for value in batch["Scalars:scalars"].to_pylist()]
        if chunk.entity_path == entities.FRAME_GROUP and not chunk.is_static:
            groups += [value[0] for value in batch["StateChange:state"].to_pylist()]
    assert np.allclose(errors, np.arange(20, -1, -1))  # [mm]
    assert groups == ["worst", "median", "best"]
    assert path.stat().st_size < 1_000_000


def test_an_estimator_without_predictions(estimator: Path, dataset_dir: Path, tmp_path: Path):
    (estimator / "predictions.parquet").unlink()
    with pytest.raises(ArtifactError, match="estimator eye has no predictions yet"):
        record_estimator(estimator, dataset_dir, tmp_path / "test.rrd")


def test_predictions_of_another_dataset(estimator: Path, dataset_dir: Path, tmp_path: Path):
    rows = [_row("none", 0.0, 500, 0.01)]
    write_parquet(pa.Table.from_pylist(rows, schema=PREDICTIONS), estimator / "predictions.parquet")
    with pytest.raises(ArtifactError, match="no frame of episode 0 step 500"):
        record_estimator(estimator, dataset_dir, tmp_path / "test.rrd")


def test_a_dataset_that_is_gone(estimator: Path, tmp_path: Path):
    with pytest.raises(ArtifactError, match="dataset gone is gone or not complete"):
        record_estimator(estimator, tmp_path / "gone", tmp_path / "test.rrd")
