"""Weights that hold code, lengths that are lies, numbers that are none: refused before they are used."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from safetensors.torch import load_file, save

from schemas.errors import ArtifactError
from stages.perception.estimator import EstimatorCard, save_estimator
from stages.perception.resnet34 import ResNet34, load_weights
from stages.policy import checkpoint
from stages.policy.actor import load_actor
from stages.policy.config import TD3Config
from stages.policy.td3 import TD3
from tests.hostile.bombs import BOMBS, LIES, NAMES, content
from tests.hostile.cases import cases
from tests.hostile.ground import Ground
from tests.hostile.stock import ESTIMATOR, LEARNT, REPLAYED, edit_manifest, seal

TRAIN = ("train-perception", "--dataset", "tiny", "--name", "new", "--weights")
LOOK = ("replay", REPLAYED, "--episode", "0", "--estimator", "whole", "--misalignment", "5", "--quiet")
ACT = ("collect", "--policy", LEARNT, "--set", "collect.tasks=['reach']")


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages end where they have read their weights."""
    monkeypatch.setattr("stages.perception.training.run", lambda *_, weights, **__: load_weights(ResNet34(), weights))
    monkeypatch.setattr("stages.collect.run.run", lambda *_, actor, **__: actor())
    monkeypatch.setattr("pipeline.steps.session.require_gl", lambda: "none")
    monkeypatch.setattr("pipeline.steps.perception.require_space", lambda *_: None)


@pytest.mark.parametrize("suffix", ["pt", "safetensors"])
@pytest.mark.parametrize("name", NAMES)
def test_weights_of_the_user(ground: Ground, request: pytest.FixtureRequest, name: str, suffix: str) -> None:
    file = ground.guard / f"weights.{suffix}"
    file.write_bytes(content(name, ground.canary))
    request.addfinalizer(file.unlink)
    with ground.case("weights"):
        ground.refused(*TRAIN, file)


def test_the_bombs_are_live(ground: Ground) -> None:
    """The canary is there once one is unpickled: else the tests here could not fail."""
    import pickle

    pickle.loads(content("pickle", ground.canary))
    assert ground.canary.exists()
    ground.canary.unlink()


@pytest.mark.parametrize("path", ["/", "/dev/null", "nowhere.pt", "outside.txt", "x" * 300, "data"])
def test_weights_that_are_no_file(ground: Ground, path: str) -> None:
    with ground.case("weights"):
        ground.refused(*TRAIN, path)


@pytest.fixture(scope="module")
def network(ground: Ground) -> Iterator[Path]:
    """A whole estimator beside the others."""
    directory = ground.data / "estimators" / "whole"
    shutil.copytree(ground.data / ESTIMATOR, directory)
    card = EstimatorCard.model_validate_json((directory / "estimator.json").read_bytes())
    torch.manual_seed(0)
    save_estimator(directory, card, ResNet34().eval().state_dict())
    edit_manifest(directory, id="estimators/whole", name="whole")
    seal(directory)
    assert ground.call(*LOOK).exit_code == 0
    yield directory
    shutil.rmtree(directory)


def _refused_although_sealed(ground: Ground, artifact: Path, file: str, data: bytes, use: tuple[str, ...]) -> str:
    """Who can write a file can write its hash into the manifest as well: what is in it is judged too."""
    with ground.damaged(artifact / file, lambda _: data), ground.damaged(artifact / "manifest.json", lambda same: same):
        seal(artifact)
        with ground.case("sealed weights"):
            return ground.refused(*use).stderr


@pytest.mark.parametrize("name", NAMES)
def test_weights_of_an_estimator(ground: Ground, network: Path, name: str) -> None:
    data = content(name, ground.canary)
    assert "not a ResNet34's weights" in _refused_although_sealed(ground, network, "estimator.safetensors", data, LOOK)


@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_an_estimator_that_knows_no_number(ground: Ground, network: Path, value: float) -> None:
    """Once it saw the cube at NaN without a word."""
    tensors = load_file(network / "estimator.safetensors")
    tensors["layer1.0.conv1.weight"][0, 0, 0, 0] = value
    said = _refused_although_sealed(ground, network, "estimator.safetensors", save(tensors), LOOK)
    assert "not finite" in said


CARDS = (b"{", b"[]", b"[" * 100_000, b'{"schema_version": "1"}', b'{"schema_version": null}', b"\xff\xfe\xff", b"")


@pytest.mark.parametrize("card", CARDS, ids=range(len(CARDS)))
def test_a_card_that_is_none(ground: Ground, network: Path, card: bytes) -> None:
    assert "estimator.json" in _refused_although_sealed(ground, network, "estimator.json", card, LOOK)


@cases(4, 60)
@given(
    st.sampled_from(["image_size", "normalisation", "precision", "cube_min", "schema_version", "ranges"]),
    st.sampled_from([-1, 0, 10**9, 10**30, "x", [[1e308, 1e308]] * 40, 1e308, {"pixel_mean": 3}]),
)
@example("image_size", 10**9)  # once images of that size were asked for
@example("ranges", [[1.0, 0.0]])  # once an unexpected StopIteration, where the CPU multiplies 8-bit integers fast
def test_a_card_that_asks_for_nonsense(ground: Ground, network: Path, key: str, value: Any) -> None:
    card = json.loads((network / "estimator.json").read_bytes()) | {key: value}
    _refused_although_sealed(ground, network, "estimator.json", json.dumps(card).encode(), LOOK)


@pytest.mark.parametrize("name", NAMES)
def test_weights_of_a_policy(ground: Ground, name: str) -> None:
    assert load_actor  # imported before the stage is
    data = content(name, ground.canary)
    said = _refused_although_sealed(ground, ground.data / LEARNT, "checkpoints/policy.safetensors", data, ACT)
    assert "holds no policy" in said


NO_NUMBERS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "not finite": lambda values: values.index_fill(0, torch.tensor([0]), float("nan")),
    "torch.int64 (24, 8)": torch.Tensor.long,
    "torch.float32 (8, 24)": lambda values: values.T.contiguous(),
    "torch.float32 (24, 7)": lambda values: values[:, :7].contiguous(),
}


@pytest.mark.parametrize("said", NO_NUMBERS)
def test_a_policy_that_knows_no_number(ground: Ground, said: str) -> None:
    """Once a dataset of actions that are none was collected, and counted as complete."""
    tensors = load_file(ground.data / LEARNT / "checkpoints/policy.safetensors")
    tensors["actor.0.weight"] = NO_NUMBERS[said](tensors["actor.0.weight"])
    artifact = ground.data / LEARNT
    refused = _refused_although_sealed(ground, artifact, "checkpoints/policy.safetensors", save(tensors), ACT)
    assert f"actor.0.weight is {said}" in refused and "train the run again" in refused


POLICIES = (b"{", b"[]", b"null", b'{"hidden": 3}', b'{"hidden": [8], "proprioception": 1, "task": []}', b"[" * 100_000)


@pytest.mark.parametrize("card", POLICIES, ids=range(len(POLICIES)))
def test_the_description_of_a_policy(ground: Ground, card: bytes) -> None:
    said = _refused_although_sealed(ground, ground.data / LEARNT, "checkpoints/policy.json", card, ACT)
    assert "holds no policy" in said


@pytest.fixture
def td3(tmp_path: Path) -> Callable[[], TD3]:
    """Networks with a checkpoint in `tmp_path`."""

    def make() -> TD3:
        return TD3(TD3Config(hidden=(8,), batch_size=4, precision="float32"), 3, 2, [0])

    checkpoint.save(tmp_path, "name/cell", checkpoint.Position(2, 0), make(), 0, {})
    return make


@pytest.mark.parametrize("name", [*BOMBS, *LIES])
def test_a_checkpoint(ground: Ground, tmp_path: Path, td3: Callable[[], TD3], name: str) -> None:
    """What a run that was interrupted goes on from; no manifest knows it yet."""
    [directory] = (tmp_path / "checkpoints").iterdir()
    (directory / "td3.safetensors").write_bytes(content(name, ground.canary))
    with ground.case("checkpoints"), pytest.raises(ArtifactError, match="cannot be read"):
        checkpoint.load(tmp_path, "name/cell", checkpoint.Position(2, 0), td3(), 0)
