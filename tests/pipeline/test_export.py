"""`pipeline export`: what a user types, and what they are told."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from pipeline.cli import cli
from schemas.progress import Silent
from stages.collect.run import run as collect
from tests.collect.small_dataset import decode, episode_files, frames, tiny, write_manifest
from tests.pipeline.fakes import answer, refused
from tests.replay.tiny_run import CELL, RUN_NAME, edit_manifest, make_run


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two short episodes, and a dataset of three with half of the frames: reach, lift, reach."""
    data = tmp_path_factory.mktemp("export") / "data"
    make_run(data, steps=3)
    dataset = data / "datasets" / "half"
    dataset.mkdir(parents=True)
    write_manifest(dataset, tiny(), collect(tiny(), dataset, dataset="half", progress=Silent()))
    return data


def export(root: Path, *arguments: object) -> Result:
    return CliRunner().invoke(cli, ["export", *map(str, arguments), "--data", str(root)])


def test_a_run_by_any_of_its_names(root: Path, tmp_path: Path) -> None:
    found = answer(export(root, f"{RUN_NAME}/{CELL}", "--format", "minari", "-o", tmp_path / "x", "--json"))
    assert found == {
        "artifact": f"runs/{RUN_NAME}/{CELL}",
        "format": "minari",
        "path": str(tmp_path / "x"),
        "episodes": 2,
        "steps": 6,
    }
    shown = export(root, RUN_NAME, "--format", "robomimic", "-o", tmp_path / "y.hdf5", "--episodes", 1)
    assert shown.stdout.startswith("episodes: 1, steps: 3 → ")
    with h5py.File(tmp_path / "y.hdf5") as file:
        assert list(file["data"]) == ["demo_0"] and "image" not in file["data/demo_0/obs"]
    quiet = export(root, RUN_NAME, "--format", "lerobot", "-o", tmp_path / "z", "--quiet", "--images")
    assert (quiet.exit_code, quiet.stdout) == (0, "") and (tmp_path / "z" / "videos").is_dir()


def test_a_dataset_is_its_kept_frames(root: Path, tmp_path: Path) -> None:
    assert export(root, "datasets/half", "--format", "robomimic", "-o", tmp_path / "x.hdf5").exit_code == 0
    dataset = root / "datasets" / "half"
    rows = pq.read_table(dataset / "frames.parquet").to_pylist()
    with h5py.File(tmp_path / "x.hdf5") as file:
        for number, path in enumerate(episode_files(dataset)):
            demo, kept = file[f"data/demo_{number}"], frames(path)
            assert demo["steps"][()].tolist() == [row["step"] for row in rows if row["episode"] == number]
            images = np.stack([decode(messages["/camera/image"]) for messages in kept])
            np.testing.assert_array_equal(demo["obs/image"][()], images)
            actions = demo["actions"][()]
            assert actions.shape == (4, 8) and demo["obs/state"].shape == (4, 14)
            closed = [messages["/action"].values[7:] or [1.0] for messages in kept]  # in reach the gripper stays closed
            np.testing.assert_allclose(actions[:, 7:], closed)


def test_without_images_a_dataset_is_numbers(root: Path, tmp_path: Path) -> None:
    asked = ("datasets/half", "--format", "lerobot", "-o", tmp_path / "x", "--no-images", "--json")
    assert answer(export(root, *asked))["steps"] == 12
    info = json.loads((tmp_path / "x" / "meta" / "info.json").read_text())
    assert not [name for name in info["features"] if "image" in name]
    assert not (tmp_path / "x" / "videos").exists()
    tasks = pq.read_table(tmp_path / "x" / "data" / "chunk-000" / "file-000.parquet")["task_index"].to_pylist()
    assert tasks == [0] * 4 + [1] * 4 + [0] * 4 and info["total_tasks"] == 2


def test_what_is_refused(root: Path, tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    refused(export(root, RUN_NAME, "--format", "minari", "-o", there), 2, "is there already: remove it")
    refused(export(root, RUN_NAME, "--format", "minari", "-o", tmp_path / "no" / "x"), 2, "there is no directory")
    refused(export(root, RUN_NAME, "--format", "minari", "-o", tmp_path / "x", "--split", "test"), 2, "unknown split")
    refused(export(root, "nothing", "--format", "minari", "-o", tmp_path / "x"), 3, "no artifact 'nothing'")
    refused(export(root, RUN_NAME, "--format", "csv", "-o", tmp_path / "x"), 2, "'csv' is not one of")
    assert list(tmp_path.iterdir()) == [there] and list(there.iterdir()) == []


def test_new_labels_have_the_camera_of_their_run(tmp_path: Path) -> None:
    run_dir = make_run(tmp_path / "data", episodes=1, steps=2)
    labels = tmp_path / "data" / "relabels" / "new" / CELL
    shutil.copytree(run_dir, labels)
    edit_manifest(labels, stage="relabel", id=f"relabels/new/{CELL}")
    asked = (f"relabels/new/{CELL}", "--format", "robomimic", "-o", tmp_path / "x", "--images", "--json")
    assert answer(export(tmp_path / "data", *asked))["artifact"] == f"relabels/new/{CELL}"
    with h5py.File(tmp_path / "x") as file:
        assert file["data/demo_0/obs/image"].shape == (2, 64, 64, 3)


def test_an_unfinished_run_is_refused(tmp_path: Path) -> None:
    run_dir = make_run(tmp_path / "data", episodes=1, steps=2)
    edit_manifest(run_dir, status="running")
    refused(export(tmp_path / "data", RUN_NAME, "--format", "minari", "-o", tmp_path / "x"), 3, "is not finished")
