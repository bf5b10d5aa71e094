"""Interruption, resumption, and what cannot be trained on."""

import json
import logging
import shutil
from contextlib import nullcontext
from pathlib import Path

import polars as pl
import pytest
import torch
from safetensors.torch import save_file

from schemas.errors import ArtifactError, DivergedError, MachineError
from schemas.progress import Silent
from stages.perception import resnet34
from stages.perception.checkpoint import drop_checkpoints
from stages.perception.config import PerceptionConfig
from stages.perception.dataset import load_frames
from stages.perception.estimator import CARD_FILE, WEIGHTS_FILE
from stages.perception.resnet34 import ResNet34
from stages.perception.training import Trainer, learning_rate, run
from tests.perception.perception_data import shifted, write_dataset

CONFIG = PerceptionConfig(epochs=3, batch_size=4, test_misalignments=())
STEPS = 3  # per epoch: 12 training frames


@pytest.fixture(scope="module", autouse=True)
def narrow():
    """A network of 0.3 million parameters: what is tested here does not depend on its size."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resnet34, "STAGES", ((1, 64), (1, 64), (1, 64), (1, 64)))
        yield


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("data") / "tiny", ("train", "train", "validation", "test"), frames=6)


def train(dataset, out, config=CONFIG, **changes):
    out.mkdir(exist_ok=True)
    options = {"estimator": "e", "weights": None, "rerender": shifted, "progress": Silent()} | changes
    return run(config, dataset, out, **options)


class InterruptAt(Silent):
    """Progress that stops the training after its step number `step`, as the user's Ctrl-C may."""

    def __init__(self, step):
        self.left, self.labels = step, []

    def task(self, label, total, done=0):
        self.labels.append((label, total, done))
        return nullcontext(self)

    def advance(self, units=1):
        if self.labels[-1][0] == "train estimator":
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt

    def note(self, text):
        pass


def interrupt(dataset, out, step):
    with pytest.raises(KeyboardInterrupt):
        train(dataset, out, progress=InterruptAt(step))


def results(out):
    epochs = pl.read_parquet(out / "epochs.parquet").drop("seconds")
    return (out / WEIGHTS_FILE).read_bytes(), epochs.rows(), pl.read_parquet(out / "predictions.parquet").rows()


def kept_epochs(out):
    return sorted(int(path.name.split("-")[1]) for path in (out / "checkpoints").iterdir())


@pytest.fixture(scope="module")
def uninterrupted(dataset, tmp_path_factory):
    out = tmp_path_factory.mktemp("uninterrupted")
    train(dataset, out)
    return results(out)


def test_resumed_training_gives_the_same_bits(dataset, uninterrupted, tmp_path):
    interrupt(dataset, tmp_path, 2 * STEPS + 2)
    assert kept_epochs(tmp_path) == [1, 2]
    assert pl.read_parquet(tmp_path / "epochs.parquet").height == 4
    progress = InterruptAt(1000)
    train(dataset, tmp_path, progress=progress)
    assert ("train estimator", 36, 24) in progress.labels
    assert results(tmp_path) == uninterrupted


def test_asked_to_stop_the_epoch_is_finished_and_kept(dataset, uninterrupted, tmp_path):
    class Stopping(Silent):
        def stopping(self):
            return True

    config = CONFIG.model_copy(update={"checkpoint_epochs": 3})
    with pytest.raises(KeyboardInterrupt):
        train(dataset, tmp_path, config, progress=Stopping())
    assert kept_epochs(tmp_path) == [1]
    train(dataset, tmp_path)
    assert results(tmp_path) == uninterrupted


def cut(data):
    return data[: len(data) // 2]


def flip_a_bit_of_a_weight(data):
    return data[:-1000] + bytes([data[-1000] ^ 1]) + data[-999:]


@pytest.mark.parametrize("damage", [cut, flip_a_bit_of_a_weight])
def test_damaged_checkpoint_falls_back_to_the_one_before(dataset, uninterrupted, tmp_path, caplog, damage):
    interrupt(dataset, tmp_path, 2 * STEPS + 1)
    [newest] = (tmp_path / "checkpoints").glob("epoch-000002-*.safetensors")
    newest.write_bytes(damage(newest.read_bytes()))
    progress = InterruptAt(1000)
    with caplog.at_level(logging.WARNING):
        train(dataset, tmp_path, progress=progress)
    assert f"{newest.name} is damaged" in caplog.text
    assert ("train estimator", 36, 12) in progress.labels
    assert results(tmp_path) == uninterrupted


def test_another_estimators_checkpoint_is_not_gone_on_from(dataset, uninterrupted, tmp_path, caplog):
    """Its hash holds and its network fits."""
    for name, changes in (
        ("other", {"estimator": "other", "config": CONFIG.model_copy(update={"seed": 5})}),
        ("e", {}),
    ):
        with pytest.raises(KeyboardInterrupt):
            train(dataset, tmp_path / name, progress=InterruptAt(STEPS + 1), **changes)
    shutil.rmtree(tmp_path / "e" / "checkpoints")
    shutil.copytree(tmp_path / "other" / "checkpoints", tmp_path / "e" / "checkpoints")
    with caplog.at_level(logging.WARNING):
        train(dataset, tmp_path / "e")
    assert "is damaged, or another's" in caplog.text
    assert results(tmp_path / "e") == uninterrupted


def test_without_a_readable_checkpoint_training_starts_anew(dataset, uninterrupted, tmp_path):
    interrupt(dataset, tmp_path, STEPS + 1)
    [only] = (tmp_path / "checkpoints").iterdir()
    only.write_bytes(b"")
    train(dataset, tmp_path)
    assert results(tmp_path) == uninterrupted


def test_interrupted_test_does_not_train_again(dataset, uninterrupted, tmp_path):
    def fail(refs, kind, degrees):
        raise MachineError("no GL")

    config = CONFIG.model_copy(update={"test_misalignments": (5.0,)})
    with pytest.raises(MachineError, match="no GL"):
        train(dataset, tmp_path, config, rerender=fail)
    train(dataset, tmp_path, config, progress=InterruptAt(1))  # a single training step would interrupt
    assert results(tmp_path)[0] == uninterrupted[0]


def test_killed_when_only_the_manifest_was_missing_it_tests_again(dataset, uninterrupted, tmp_path):
    """The checkpoints go first; it goes on to the same bits without a step of training."""
    train(dataset, tmp_path)
    card = (tmp_path / CARD_FILE).read_bytes()
    assert not (tmp_path / "checkpoints").exists()
    (tmp_path / "predictions.parquet").unlink()
    train(dataset, tmp_path, progress=InterruptAt(1))  # a single training step would interrupt
    assert results(tmp_path) == uninterrupted and (tmp_path / CARD_FILE).read_bytes() == card


def fewer_epochs(path):
    pl.read_parquet(path).head(4).write_parquet(path)


def another_best_epoch(path):
    card = json.loads(path.read_bytes())
    path.write_text(json.dumps(card | {"best_epoch": card["best_epoch"] % 3 + 1}))


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        (WEIGHTS_FILE, lambda path: path.write_bytes(flip_a_bit_of_a_weight(path.read_bytes()))),
        (WEIGHTS_FILE, lambda path: path.unlink()),
        (CARD_FILE, lambda path: path.write_bytes(cut(path.read_bytes()))),
        (CARD_FILE, another_best_epoch),
        ("epochs.parquet", lambda path: path.write_bytes(cut(path.read_bytes()))),
        ("epochs.parquet", fewer_epochs),
    ],
)
def test_an_ended_training_that_is_not_whole_is_no_end(dataset, uninterrupted, tmp_path, name, damage):
    train(dataset, tmp_path)
    damage(tmp_path / name)
    progress = InterruptAt(1000)
    train(dataset, tmp_path, progress=progress)
    assert ("train estimator", 36, 0) in progress.labels
    assert results(tmp_path) == uninterrupted


def test_the_newest_checkpoint_goes_last(dataset, tmp_path, monkeypatch):
    """Killed in between, there is no older one alone."""
    interrupt(dataset, tmp_path, 2 * STEPS + 2)
    unlinked, unlink = [], Path.unlink
    monkeypatch.setattr(Path, "unlink", lambda path: (unlinked.append(path.name[:12]), unlink(path)))
    drop_checkpoints(tmp_path)
    assert unlinked == ["epoch-000001", "epoch-000002"] and not (tmp_path / "checkpoints").exists()


def test_checkpoints_come_every_so_many_epochs(dataset, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        train(
            dataset,
            tmp_path,
            CONFIG.model_copy(update={"checkpoint_epochs": 2}),
            progress=InterruptAt(2 * STEPS + 1),
        )
    assert kept_epochs(tmp_path) == [2]


def test_another_seed_gives_other_weights(dataset, uninterrupted, tmp_path):
    train(dataset, tmp_path, CONFIG.model_copy(update={"seed": 1}))
    assert results(tmp_path)[0] != uninterrupted[0]


def test_divergence_is_reported_at_once(dataset, tmp_path):
    weights = ResNet34().state_dict()
    weights["conv1.weight"][0, 0, 0, 0] = float("nan")
    save_file(weights, tmp_path / "nan.safetensors")
    with pytest.raises(DivergedError, match=r"loss is nan in epoch 1, step 0; lower perception\.learning_rate"):
        train(dataset, tmp_path / "out", weights=tmp_path / "nan.safetensors")


def test_divergence_in_validation_is_reported(dataset, tmp_path):
    """Statistics of batch norms may overflow though every training step is finite."""
    weights = ResNet34().state_dict()
    weights["bn1.running_mean"][0] = float("-inf")
    save_file(weights, tmp_path / "inf.safetensors")
    with pytest.raises(DivergedError, match=r"validation loss is nan after epoch 1"):
        train(dataset, tmp_path / "out", weights=tmp_path / "inf.safetensors")


def test_training_starts_from_the_weights_given(dataset, tmp_path):
    weights = ResNet34(outputs=1000).state_dict()
    save_file(weights, tmp_path / "imagenet.safetensors")
    trainer = Trainer(CONFIG, load_frames(dataset, tmp_path, Silent()), torch.device("cpu"))
    network = trainer.start("e", tmp_path / "imagenet.safetensors").network
    assert torch.equal(network.conv1.weight, weights["conv1.weight"])
    assert not torch.equal(trainer.start("e", None).network.conv1.weight, weights["conv1.weight"])


def test_training_needs_two_frames(tmp_path):
    dataset = write_dataset(tmp_path / "tiny", ("train", "validation", "test"), frames=1)
    with pytest.raises(ArtifactError, match="two frames"):
        train(dataset, tmp_path / "out")


def test_too_few_rerendered_frames_are_an_error(dataset, tmp_path):
    config = PerceptionConfig(epochs=1, batch_size=12, test_misalignments=(5.0,))
    with pytest.raises(ArtifactError, match="5 images for 6 test frames"):
        train(dataset, tmp_path, config, rerender=lambda refs, kind, degrees: shifted(refs[:5], kind, degrees))


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_absent_gpu_is_an_error_of_the_machine(dataset, tmp_path):
    with pytest.raises(MachineError, match="cuda"):
        train(dataset, tmp_path, CONFIG.model_copy(update={"device": "cuda"}))


def test_learning_rate_rises_linearly_and_falls_to_zero():
    rates = [learning_rate(step, 100, 1e-3) for step in range(101)]
    assert rates[0] == pytest.approx(4e-5)
    assert rates[10] == pytest.approx(0.5 * (rates[0] + rates[20]))
    assert rates[20] == max(rates) == pytest.approx(1e-3)
    assert rates[60] == pytest.approx(5e-4)
    assert rates[100] == pytest.approx(0.0, abs=1e-12)


def test_learning_rate_of_a_single_step_is_finite():
    assert 0 < learning_rate(0, 1, 1e-3) <= 1e-3
