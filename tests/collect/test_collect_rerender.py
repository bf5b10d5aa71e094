"""Re-rendering shows the same states from the misaligned nominal camera."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from schemas.datasets import FrameRef
from schemas.errors import ArtifactError
from schemas.progress import Silent
from stages.collect.rerender import make_rerender
from stages.collect.run import run
from stages.sim.camera import misaligned, nominal_pose
from tests.collect.small_dataset import (
    CONFIG,
    bounding_box,
    cube_box,
    decode,
    episode_files,
    frames,
    hides_nothing,
    red_pixels,
    tiny,
    write_manifest,
)


def references(dataset: Path) -> list[FrameRef]:
    rows = pq.read_table(dataset / "frames.parquet", columns=["file", "episode", "step", "time_ns"]).to_pylist()
    return [FrameRef(**row) for row in rows]


def test_without_displacement_and_misalignment_the_same_images_come_back(tmp_path: Path) -> None:
    config = tiny(camera_translation=0.0, camera_rotation=0.0)
    write_manifest(tmp_path, config, run(config, tmp_path, dataset="d", progress=Silent()))
    frame_references = references(tmp_path)
    recorded = [decode(found["/camera/image"]) for path in episode_files(tmp_path) for found in frames(path)]
    order = np.random.default_rng(0).permutation(len(recorded))  # any order, files interleaved
    rendered = list(make_rerender(tmp_path)([frame_references[i] for i in order], "pan", 0.0))
    assert len(rendered) == 12
    for i, image in zip(order, rendered, strict=True):
        np.testing.assert_array_equal(image, recorded[i])


@pytest.mark.parametrize(("kind", "degrees"), [("pan", 5.0), ("orbit", 10.0)])
def test_cube_is_where_the_misaligned_camera_sees_it(dataset: Path, kind: str, degrees: float) -> None:
    pose = misaligned(nominal_pose(CONFIG.camera), kind, degrees, np.array(CONFIG.camera.target))
    recorded = [(episode, found) for episode, path in enumerate(episode_files(dataset)) for found in frames(path)]
    chosen = [i for i, found in enumerate(recorded) if hides_nothing(*found)][::4]
    frame_references = references(dataset)
    images = make_rerender(dataset)([frame_references[i] for i in chosen], kind, degrees)
    for i, image in zip(chosen, images, strict=True):
        assert image.shape == (128, 128, 3)
        _, box = cube_box(recorded[i][1], pose)
        seen = np.clip(box, 0, 128)  # turned by 10 degrees, the cube may be cut by the image's edge
        assert np.abs(seen - bounding_box(red_pixels(image))).max() < 1.5
    assert len(chosen) >= 3


def test_directory_without_manifest_is_an_artifact_error(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"has no manifest\.json, so it is no artifact"):
        make_rerender(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema_version": 99}, "made by a newer version of the pipeline"),
        ({"config": {}}, "is no dataset's: .* has no 'world'"),
    ],
)
def test_manifest_of_another_version_or_kind_is_an_artifact_error(
    dataset: Path, tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    manifest = json.loads((dataset / "manifest.json").read_text()) | change
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ArtifactError, match=said):
        make_rerender(tmp_path)


def test_unknown_time_is_an_artifact_error(dataset: Path) -> None:
    first = references(dataset)[0]
    with pytest.raises(ArtifactError, match="no /sim/state at 1 ns"):
        list(make_rerender(dataset)([first._replace(time_ns=1)], "pan", 5.0))
