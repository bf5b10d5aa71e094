"""Reading an episode from a run's Parquet, and what is said of logs that are not whole."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from schemas.errors import ArtifactError
from schemas.files import write_parquet
from stages.replay.logs import load_episode
from tests.replay.tiny_run import RUN_NAME, edit_manifest, tamper

MakeRun = Callable[..., Path]
PART = "transitions/part-00000.parquet"


def test_rows_are_those_of_the_episode_in_order_of_step(run_dir: Path):
    logged = load_episode(run_dir, "final", 1)
    assert logged.steps == 20
    assert logged.rows["step"].tolist() == list(range(20))
    assert set(logged.rows["episode"]) == {1}
    assert logged.rows["action"].shape == (20, 7)
    assert logged.rows["action"].dtype == np.float32
    assert logged.vector("eef").shape == (20, 3)
    assert logged.rows["time_ns"][[0, -1]].tolist() == [50_000_000, 1_000_000_000]
    assert logged.rows["phase"].tolist() == ["dense"] * 10 + ["sparse"] * 10
    assert logged.task == "reach"
    assert logged.run.startswith(f"{RUN_NAME}/reach-dense2sparse")
    assert logged.initial_state.dtype == np.float64
    assert logged.initial_state.shape == logged.final_state.shape


def test_missing_estimates_are_nan(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=3)
    tamper(run, "cube_est_x", 1, lambda _: None)
    assert np.isnan(load_episode(run, "final", 0).vector("cube_est")[:, 0]).tolist() == [False, True, False]


@pytest.mark.parametrize(("split", "episode"), [("final", 2), ("train", 0)])
def test_an_episode_that_does_not_exist_names_those_that_do(run_dir: Path, split: str, episode: int):
    with pytest.raises(ArtifactError, match=rf"no {split} episode {episode} in .*; there are: final 0 to 1"):
        load_episode(run_dir, split, episode)


def test_a_run_that_has_logged_nothing_yet(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    (run / "episodes.parquet").unlink()
    with pytest.raises(ArtifactError, match="has logged no episode yet"):
        load_episode(run, "final", 0)


def test_a_run_without_transitions(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    (run / PART).unlink()
    with pytest.raises(ArtifactError, match=r"has no transitions/part-\*\.parquet"):
        load_episode(run, "final", 0)


@pytest.mark.parametrize("file", ["episodes.parquet", PART])
def test_a_truncated_file_is_named(fresh_run: MakeRun, file: str):
    run = fresh_run(episodes=1, steps=2)
    path = run / file
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ArtifactError, match=rf"{re.escape(str(path))} is damaged"):
        load_episode(run, "final", 0)


def test_another_schema_names_the_columns(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    table = pq.read_table(run / PART).drop_columns(["lifted", "phase"])
    write_parquet(table, run / PART)
    with pytest.raises(ArtifactError, match="another schema: it lacks phase, lifted"):
        load_episode(run, "final", 0)


def test_another_type_is_named(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    table = pq.read_table(run / PART)
    index = table.column_names.index("eef_x")
    write_parquet(table.set_column(index, "eef_x", table["eef_x"].cast("float64")), run / PART)
    with pytest.raises(ArtifactError, match="has another type of eef_x"):
        load_episode(run, "final", 0)


def test_a_foreign_parquet_file_among_the_parts(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    (run / PART).write_bytes((run / "episodes.parquet").read_bytes())
    with pytest.raises(ArtifactError, match="is not a transitions file"):
        load_episode(run, "final", 0)


def test_an_episode_cut_short_is_incomplete(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=4)
    write_parquet(pq.read_table(run / PART).slice(0, 3), run / PART)
    with pytest.raises(ArtifactError, match="should have 4 steps, its transitions have 3"):
        load_episode(run, "final", 0)


def test_a_newer_schema_version_is_refused(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    edit_manifest(run, schema_version=99)
    with pytest.raises(ArtifactError, match="made by a newer version of the pipeline .schema 99"):
        load_episode(run, "final", 0)


def test_a_dataset_is_no_run(fresh_run: MakeRun):
    run = fresh_run(episodes=1, steps=2)
    edit_manifest(run, stage="collect")
    with pytest.raises(ArtifactError, match="is an artifact of collect, not a run"):
        load_episode(run, "final", 0)


def test_a_directory_without_manifest(tmp_path: Path):
    with pytest.raises(ArtifactError, match="is no artifact of this pipeline"):
        load_episode(tmp_path, "final", 0)
