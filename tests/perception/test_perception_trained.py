"""One small training, looked at from all sides: what it learns, what it writes, and the estimator it leaves."""

import json

import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest
import torch

from schemas.errors import ArtifactError
from schemas.progress import Silent
from schemas.tables import EPOCHS, PREDICTIONS
from stages.perception import estimator as estimator_file
from stages.perception import frozen
from stages.perception.config import PerceptionConfig
from stages.perception.estimator import CARD_FILE, WEIGHTS_FILE, Estimator
from stages.perception.quantised import is_supported
from stages.perception.training import run
from tests.perception.perception_data import CAMERA, SIZE, draw, positions, shifted, write_dataset

EPISODES = [*["train"] * 10, "validation", "test"]
FRAMES = 48  # per episode
CONFIG = PerceptionConfig(epochs=5, batch_size=32, test_misalignments=(3.0,), checkpoint_epochs=5)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Directory of a trained estimator, and the summary of its training."""
    dataset = write_dataset(tmp_path_factory.mktemp("data") / "tiny", EPISODES, FRAMES)
    out = tmp_path_factory.mktemp("estimator")
    torch_state, numpy_state = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    summary = run(CONFIG, dataset, out, estimator="small", weights=None, rerender=shifted, progress=Silent())
    assert torch.equal(torch.get_rng_state(), torch_state)
    assert np.array_equal(np.random.get_state()[1], numpy_state)  # noqa: NPY002
    return out, summary


@pytest.fixture(scope="module")
def estimator(trained):
    return Estimator.load(trained[0])


def images(episode, count):
    return np.stack([draw(position) for position in positions(episode, count)])


def test_unseen_images_are_understood(estimator):
    """Episodes that are in no split: uniform positions, whose mean is about 12 cm away from them on average."""
    true = np.concatenate([positions(episode, 40) for episode in (100, 101)])
    estimated = np.concatenate([estimator.predict(images(episode, 40)) for episode in (100, 101)])
    assert estimated.dtype == np.float32
    errors = np.linalg.norm(estimated - true, axis=1)
    assert errors.mean() < 0.025
    assert np.abs(estimated[:, 2] - true[:, 2]).mean() < 0.015  # of ± 5 cm


def test_summary(trained):
    _, summary = trained
    assert summary["parameters"] == 21_286_211
    assert summary["epochs"] == 5
    assert 0 < summary["test_median_error"] < summary["test_p95_error"]
    assert 0 < summary["test_mean_error"] < summary["test_p95_error"]
    assert set(summary["misalignment"]) == {"pan03", "orbit03"}
    json.dumps(summary)


def test_misalignment_shows_in_predictions(trained):
    """The stand-in for pan moves the square by 3 of the 24 pixels that 0.3 m are; its orbit changes nothing."""
    out, summary = trained
    assert summary["misalignment"]["orbit03"] == summary["test_mean_error"]
    table = pl.read_parquet(out / "predictions.parquet")
    true = table.filter(pl.col("misalignment_kind") == "none")
    pan = table.filter(pl.col("misalignment_kind") == "pan", pl.col("cube_true_x") < 0.08)
    moved = (pan["cube_est_x"] - pan["cube_true_x"]).mean()
    assert moved == pytest.approx(3 / 24 * 0.3, abs=0.015)
    assert true["error"].mean() == pytest.approx(summary["test_mean_error"], rel=1e-5)


def test_predictions_have_a_row_for_each_test_frame_and_case(trained):
    table = pq.read_table(trained[0] / "predictions.parquet")
    assert table.schema.equals(PREDICTIONS)
    frame = pl.DataFrame(pl.from_arrow(table))
    assert frame.height == 3 * FRAMES
    assert set(zip(frame["misalignment_kind"], frame["misalignment_deg"], strict=True)) == {
        ("none", 0.0),
        ("pan", 3.0),
        ("orbit", 3.0),
    }
    assert set(frame["episode"]) == {11}
    true = frame.select("cube_true_x", "cube_true_y", "cube_true_z").to_numpy()
    assert true[:FRAMES] == pytest.approx(positions(11, FRAMES))
    estimated = frame.select("cube_est_x", "cube_est_y", "cube_est_z").to_numpy()
    assert frame["error"].to_numpy() == pytest.approx(np.linalg.norm(estimated - true, axis=1), abs=1e-6)


def test_epochs_have_rows_of_both_splits_and_one_of_the_test(trained):
    out, summary = trained
    table = pq.read_table(out / "epochs.parquet")
    assert table.schema.equals(EPOCHS)
    frame = pl.DataFrame(pl.from_arrow(table)).with_columns(pl.col("split").cast(pl.String))
    rows = list(zip(frame["split"], frame["epoch"], strict=True))
    assert rows == [(split, epoch) for epoch in range(1, 6) for split in ("train", "validation")] + [("test", 5)]
    assert frame["mean_error"][-1] == summary["test_mean_error"]
    train = frame.filter(pl.col("split") == "train")
    assert train["mean_error"][0] > 3 * train["mean_error"][-1]
    assert (train["loss"] >= train["mean_error"] ** 2).all()  # Jensen; both in metres
    assert train["learning_rate"][-1] < 0.05 * CONFIG.learning_rate


def test_kept_weights_are_those_of_the_lowest_validation_error(trained, estimator):
    frame = pl.read_parquet(trained[0] / "epochs.parquet").filter(pl.col("split") == "validation")
    best = frame["mean_error"].arg_min()
    assert estimator.card.best_epoch == frame["epoch"][best]
    true = positions(10, FRAMES)
    errors = np.linalg.norm(estimator.predict(images(10, FRAMES)) - true, axis=1)
    assert errors.mean() == pytest.approx(frame["mean_error"][best], abs=1e-3)


def test_artifact_says_what_rebuilds_it_and_nothing_is_left_over(trained, estimator):
    out, _ = trained
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ["epochs.parquet", "predictions.parquet", CARD_FILE, WEIGHTS_FILE]
    )
    assert (estimator.card.dataset, estimator.card.estimator) == ("tiny", "small")
    assert (estimator.camera, estimator.image_size) == (CAMERA, SIZE)
    training = np.concatenate([positions(episode, FRAMES) for episode in range(10)])
    assert estimator.card.cube_min == pytest.approx(training.min(axis=0))
    assert estimator.card.cube_max == pytest.approx(training.max(axis=0))


@pytest.mark.parametrize("packed", [True, False])
def test_bfloat16_costs_less_than_a_millimetre(trained, monkeypatch, packed):
    """Packed for oneDNN, and as it runs where there is none: 0.5 mm of rounding beside a centimetre of error."""
    exact = Estimator.load(trained[0], precision="float32").predict(images(100, 40))
    if not packed:
        monkeypatch.setattr(frozen, "has_onednn", lambda device: False)
    monkeypatch.setattr(estimator_file, "arithmetic", lambda precision, device: torch.bfloat16)  # also where it is slow
    rounded = Estimator.load(trained[0], precision="bfloat16").predict(images(100, 40))
    assert not np.array_equal(rounded, exact)
    assert np.linalg.norm(rounded - exact, axis=1).mean() < 1e-3
    mean_errors = [np.linalg.norm(estimate - positions(100, 40), axis=1).mean() for estimate in (exact, rounded)]
    assert mean_errors[1] == pytest.approx(mean_errors[0], abs=2e-4)


@pytest.mark.skipif(not is_supported(), reason="this CPU is not made for 8-bit networks")
def test_8_bit_integers_cost_less_than_a_tenth_of_the_error(trained):
    """As the estimator runs by default where the CPU can: single estimates move, the error hardly."""
    exact = Estimator.load(trained[0], precision="float32").predict(images(100, 40))
    integers = Estimator.load(trained[0]).predict(images(100, 40))
    moved = np.linalg.norm(integers - exact, axis=1).mean()
    errors = [np.linalg.norm(estimate - positions(100, 40), axis=1).mean() for estimate in (exact, integers)]
    assert 0 < moved < 5e-3
    assert errors[1] < 1.1 * errors[0]


@pytest.mark.parametrize("precision", ["float32", "bfloat16", None])
def test_estimate_does_not_depend_on_the_rest_of_the_batch(trained, precision):
    estimator = Estimator.load(trained[0], precision=precision)
    batch = images(100, 12)
    together = estimator.predict(batch)
    for size in (1, 2, 3, 4):
        parts = [estimator.predict(batch[start : start + size]) for start in range(0, 12, size)]
        assert np.array_equal(np.concatenate(parts), together)


def test_no_images_give_no_positions(estimator):
    assert estimator.predict(np.empty((0, SIZE, SIZE, 3), np.uint8)).shape == (0, 3)


@pytest.mark.parametrize("shape", [(1, 64, 64, 3), (1, 3, SIZE, SIZE), (SIZE, SIZE, 3)])
def test_images_of_another_shape_are_refused(estimator, shape):
    with pytest.raises(ValueError, match="the estimator takes uint8"):
        estimator.predict(np.zeros(shape, np.uint8))


def test_images_of_another_type_are_refused(estimator):
    with pytest.raises(ValueError, match="float32"):
        estimator.predict(np.zeros((1, SIZE, SIZE, 3), np.float32))


@pytest.fixture
def copied(trained, tmp_path):
    for name in (CARD_FILE, WEIGHTS_FILE):
        (tmp_path / name).write_bytes((trained[0] / name).read_bytes())
    return tmp_path


def test_estimator_rebuilds_from_its_two_files_alone(copied, estimator):
    assert np.array_equal(Estimator.load(copied).predict(images(100, 4)), estimator.predict(images(100, 4)))


@pytest.mark.parametrize("name", [CARD_FILE, WEIGHTS_FILE])
def test_missing_files_are_named(copied, name):
    (copied / name).unlink()
    with pytest.raises(ArtifactError, match=name):
        Estimator.load(copied)


@pytest.mark.parametrize("name", [CARD_FILE, WEIGHTS_FILE])
@pytest.mark.parametrize("keep", [0.0, 0.5])
def test_truncated_files_are_named(copied, name, keep):
    content = (copied / name).read_bytes()
    (copied / name).write_bytes(content[: int(keep * len(content))])
    with pytest.raises(ArtifactError, match=name):
        Estimator.load(copied)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 99}, "newer"),
        ({"schema_version": "?"}, CARD_FILE),
        ({"architecture": "vgg"}, CARD_FILE),
        ({"image_size": None}, CARD_FILE),
    ],
)
def test_cards_of_other_kinds_are_refused(copied, change, message):
    card = json.loads((copied / CARD_FILE).read_text())
    (copied / CARD_FILE).write_text(json.dumps(card | change))
    with pytest.raises(ArtifactError, match=message):
        Estimator.load(copied)
