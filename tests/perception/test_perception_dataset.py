import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.datasets import FrameRef
from schemas.errors import ArtifactError
from schemas.progress import Silent
from schemas.tables import FRAMES
from stages.perception.dataset import load_frames
from tests.perception.perception_data import (
    CAMERA,
    PERIOD_NS,
    SIZE,
    draw,
    frame_rows,
    positions,
    write_dataset,
    write_episode,
    write_manifest,
)

SPLITS = ("train", "test", "validation")


@pytest.fixture
def dataset(tmp_path):
    return write_dataset(tmp_path / "tiny", SPLITS, frames=4)


def load(dataset, **options):
    return load_frames(dataset, dataset, Silent(), **options)


def test_images_and_positions_belong_together(dataset):
    frames = load(dataset)
    assert frames.images.shape == (12, SIZE, SIZE, 3)
    assert frames.images.dtype == np.uint8
    for image, position in zip(frames.images, frames.positions, strict=True):
        assert np.array_equal(image, draw(position))
    assert np.array_equal(frames.positions[4:8], positions(1, 4))
    assert frames.indices("test").tolist() == [4, 5, 6, 7]
    assert frames.refs[5] == FrameRef("episodes/episode-000001.mcap", 1, 1, PERIOD_NS)
    assert (frames.dataset, frames.image_size, frames.camera) == ("tiny", SIZE, CAMERA)


def test_frames_may_be_fewer_than_images_and_in_any_order(dataset):
    table = pq.read_table(dataset / "frames.parquet").take([10, 1, 6, 3])
    pq.write_table(table, dataset / "frames.parquet")
    frames = load(dataset)
    assert [(ref.episode, ref.step) for ref in frames.refs] == [(2, 2), (0, 1), (1, 2), (0, 3)]
    for image, position in zip(frames.images, frames.positions, strict=True):
        assert np.array_equal(image, draw(position))


def test_jpeg_images_are_read(dataset):
    write_episode(dataset / "episodes/episode-000000.mcap", positions(0, 4), "JPEG")
    difference = load(dataset).images[0].astype(int) - draw(positions(0, 4)[0])
    assert np.abs(difference).mean() < 10


def test_images_beyond_the_memory_limit_are_mapped_from_a_file_that_has_no_name(dataset):
    frames = load(dataset, memory_limit=1000)
    assert isinstance(frames.images, np.memmap)
    assert np.array_equal(frames.images, load(dataset).images)
    assert sorted(path.name for path in dataset.iterdir()) == ["episodes", "frames.parquet", "manifest.json"]


def test_missing_episode_is_named(dataset):
    (dataset / "episodes/episode-000001.mcap").unlink()
    with pytest.raises(ArtifactError, match=r"episode-000001\.mcap"):
        load(dataset)


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9])
def test_truncated_episode_is_named(dataset, keep):
    file = dataset / "episodes/episode-000001.mcap"
    file.write_bytes(file.read_bytes()[: int(keep * file.stat().st_size)])
    with pytest.raises(ArtifactError, match=r"episode-000001\.mcap"):
        load(dataset)


def test_foreign_episode_is_named(dataset):
    (dataset / "episodes/episode-000002.mcap").write_text("no MCAP file at all, but some words instead")
    with pytest.raises(ArtifactError, match=r"episode-000002\.mcap"):
        load(dataset)


def test_frame_without_image_is_named_with_its_time(dataset):
    write_episode(dataset / "episodes/episode-000002.mcap", positions(2, 3))
    with pytest.raises(ArtifactError, match=r"episode-000002\.mcap: no /camera/image at 150000000 ns"):
        load(dataset)


def test_image_of_another_size_is_named(dataset):
    write_manifest(dataset, config={"camera": CAMERA | {"image_size": 64}})
    with pytest.raises(ArtifactError, match=r"episode-000000\.mcap: the image at 0 ns is \(32, 32, 3\)"):
        load(dataset)


@pytest.mark.parametrize("name", ["manifest.json", "frames.parquet"])
@pytest.mark.parametrize("content", [None, "nonsense"])
def test_damaged_files_are_named(dataset, name, content):
    (dataset / name).unlink()
    if content:
        (dataset / name).write_text(content)
    with pytest.raises(ArtifactError, match=name):
        load(dataset)


@pytest.mark.parametrize("change", [{"schema_version": 99}, {"config": {}}])
def test_manifests_of_other_kinds_are_refused(dataset, change):
    write_manifest(dataset, **change)
    with pytest.raises(ArtifactError, match=r"manifest\.json"):
        load(dataset)


def test_missing_columns_are_named(dataset):
    table = pq.read_table(dataset / "frames.parquet").drop_columns(["cube_z"])
    pq.write_table(table, dataset / "frames.parquet")
    with pytest.raises(ArtifactError, match="cube_z"):
        load(dataset)


def test_empty_split_is_named(tmp_path):
    dataset = write_dataset(tmp_path / "tiny", ("train", "train", "test"), frames=2)
    with pytest.raises(ArtifactError, match="validation"):
        load(dataset)


def test_episode_in_two_splits_is_refused(dataset):
    rows = [row for episode, split in enumerate(SPLITS) for row in frame_rows(episode, split, positions(episode, 4))]
    rows[0]["split"] = "test"
    pq.write_table(pa.Table.from_pylist(rows, schema=FRAMES), dataset / "frames.parquet")
    with pytest.raises(ArtifactError, match="two splits"):
        load(dataset)
