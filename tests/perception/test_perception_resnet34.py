import pytest
import torch
from safetensors.torch import save_file

from schemas.errors import ArtifactError
from stages.perception.resnet34 import ResNet34, load_weights


@pytest.fixture(scope="module")
def imagenet() -> dict[str, torch.Tensor]:
    """A state dict of the shape of torchvision's, with 1000 classes and weights of its own."""
    return ResNet34(outputs=1000).state_dict()


def test_parameter_counts_are_the_known_ones():
    counts = [sum(parameter.numel() for parameter in ResNet34(outputs).parameters()) for outputs in (1000, 3)]
    assert counts == [21_797_672, 21_286_211]


def test_keys_are_torchvisions(imagenet):
    block = [
        f"{layer}.{name}" for layer in ("bn1", "bn2") for name in ("weight", "bias", "running_mean", "running_var")
    ]
    block += ["conv1.weight", "conv2.weight", "bn1.num_batches_tracked", "bn2.num_batches_tracked"]
    expected = {"fc.weight", "fc.bias", "conv1.weight"} | {key for key in imagenet if key.startswith("bn1.")}
    for layer, blocks in zip(("layer1", "layer2", "layer3", "layer4"), (3, 4, 6, 3), strict=True):
        expected |= {f"{layer}.{index}.{key}" for index in range(blocks) for key in block}
        if layer != "layer1":
            norm = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")
            expected |= {f"{layer}.0.downsample.0.weight", *(f"{layer}.0.downsample.1.{key}" for key in norm)}
    assert set(imagenet) == expected
    assert len(imagenet) == 218  # as torchvision.models.resnet34().state_dict()
    assert imagenet["layer2.0.downsample.0.weight"].shape == (128, 64, 1, 1)


def test_output_is_three_numbers_an_image():
    assert ResNet34().eval()(torch.zeros(2, 3, 64, 64)).shape == (2, 3)


@pytest.mark.parametrize("name", ["resnet34.safetensors", "resnet34.pth"])
def test_imagenet_weights_load_but_for_the_classes(imagenet, tmp_path, name):
    file = tmp_path / name
    save_file(imagenet, file) if name.endswith(".safetensors") else torch.save(imagenet, file)
    network = ResNet34()
    fc = network.fc.weight.clone()
    load_weights(network, file)
    assert torch.equal(network.layer4[2].conv2.weight, imagenet["layer4.2.conv2.weight"])
    assert torch.equal(network.fc.weight, fc)


def test_weights_from_before_batch_counters_load(imagenet, tmp_path):
    old = {key: value for key, value in imagenet.items() if not key.endswith("num_batches_tracked")}
    save_file(old, tmp_path / "old.safetensors")
    load_weights(ResNet34(), tmp_path / "old.safetensors")


def test_mismatch_names_the_keys(imagenet, tmp_path):
    wrong = dict(imagenet)
    del wrong["layer1.0.conv1.weight"]
    wrong["layer9.weight"] = torch.zeros(1)
    wrong["conv1.weight"] = torch.zeros(64, 3, 3, 3)
    save_file(wrong, tmp_path / "wrong.safetensors")
    with pytest.raises(ArtifactError) as raised:
        load_weights(ResNet34(), tmp_path / "wrong.safetensors")
    message = str(raised.value)
    assert "missing: layer1.0.conv1.weight" in message
    assert "unknown: layer9.weight" in message
    assert "of another shape: conv1.weight" in message


@pytest.mark.parametrize("name", ["absent.pth", "text.pth", "text.safetensors", "list.pth"])
def test_what_is_no_weights_file_is_an_artifact_error(tmp_path, name):
    (tmp_path / "text.pth").write_text("hello")
    (tmp_path / "text.safetensors").write_text("hello")
    torch.save([torch.zeros(1)], tmp_path / "list.pth")
    with pytest.raises(ArtifactError, match=name):
        load_weights(ResNet34(), tmp_path / name)


class Touch:
    """Pickled, it creates a file when it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return (open, (str(self.file), "w"))


def test_code_in_a_weights_file_is_not_run(tmp_path):
    torch.save({"conv1.weight": Touch(tmp_path / "touched")}, tmp_path / "code.pth")
    with pytest.raises(ArtifactError, match=r"code\.pth"):
        load_weights(ResNet34(), tmp_path / "code.pth")
    assert not (tmp_path / "touched").exists()
