"""Runs and datasets in the formats of other projects: what their own readers find is what was logged."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import h5py
import minari
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import robomimic.utils.obs_utils as robomimic_observations
import robosuite
from robomimic.utils.dataset import SequenceDataset

from schemas.errors import ArtifactError, ConfigError
from schemas.progress import Silent
from schemas.tables import EPISODES
from stages.replay.formats import lerobot_files, lerobot_stats
from stages.replay.formats.export import Format, export, open_source
from stages.replay.logs import load_episode
from stages.replay.rollout import roll_out
from tests.replay.tiny_run import edit_manifest, tamper

CAMERA = "observation.images.camera"
STEPS = 20  # of each of the run's two episodes
FORMATS: tuple[Format, ...] = ("lerobot", "robomimic", "minari")


def exported(
    artifact: Path, form: Format, target: Path, images: bool = False, split: str | None = None, limit: int | None = None
) -> Path:
    export(open_source(artifact, form, split, limit, images), form, target, Silent())
    return target


def logged(run_dir: Path) -> list[dict[str, np.ndarray]]:
    return [load_episode(run_dir, "final", episode).rows for episode in range(2)]


def distinct_observations(run_dir: Path) -> None:
    """The tiny run's observations are all zero: number them, so that rows cannot be mistaken for each other."""
    for part, path in enumerate(sorted((run_dir / "transitions").glob("*.parquet"))):
        table = pq.read_table(path)
        for name, first in (("observation", 0), ("next_observation", 1)):
            numbered = (
                np.arange(first, first + STEPS, dtype=np.float32)[:, None] + 100 * part + np.zeros(23, np.float32)
            )
            place = table.schema.get_field_index(name)
            field = table.schema.field(place)
            column = pa.FixedSizeListArray.from_arrays(pa.array(numbered.ravel()), type=field.type)
            table = table.set_column(place, field, column)
        pq.write_table(table, path)


@pytest.fixture
def run(fresh_run: Callable[..., Path]) -> Path:
    run_dir = fresh_run()
    distinct_observations(run_dir)
    return run_dir


@pytest.fixture(scope="module")
def frames(run_dir: Path) -> list[np.ndarray]:
    """What replay renders of each episode, (n + 1, H, W, 3)."""
    rollouts = [roll_out(load_episode(run_dir, "final", episode)) for episode in range(2)]
    return [np.stack(rollout.frames) for rollout in rollouts]


def test_minari_reads_a_run(run: Path, tmp_path: Path) -> None:
    found = minari.MinariDataset(exported(run, "minari", tmp_path / "x") / "data")
    assert (found.total_episodes, found.total_steps) == (2, 2 * STEPS)
    assert found.observation_space.shape == (23,) and found.action_space.shape == (7,)
    for number, (episode, rows) in enumerate(zip(found, logged(run), strict=True)):
        assert episode.observations.shape == (STEPS + 1, 23) and episode.observations.dtype == np.float32
        np.testing.assert_array_equal(episode.observations[:, 0], np.arange(STEPS + 1) + 100 * number)
        np.testing.assert_array_equal(episode.actions, rows["action"])
        np.testing.assert_array_equal(episode.rewards, rows["reward_used"])
        assert not episode.terminations.any()
        assert episode.truncations.tolist() == [False] * (STEPS - 1) + [True]
        assert episode.infos["step"].tolist() == list(range(-1, STEPS))
        np.testing.assert_array_equal(episode.infos["reward_dense_true"][1:], rows["reward_dense_true"])
        assert found.observation_space.contains(episode.observations[0])
        assert found.action_space.contains(episode.actions[0])


def test_minari_finds_it_among_its_datasets(run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    (tmp_path / "mine").mkdir()
    exported(run_dir, "minari", tmp_path / "mine" / "reach-v0")
    assert minari.load_dataset("mine/reach-v0").total_steps == 2 * STEPS


def test_minari_images_are_the_rerendered_frames(run_dir: Path, tmp_path: Path, frames: list[np.ndarray]) -> None:
    found = minari.MinariDataset(exported(run_dir, "minari", tmp_path / "x", images=True) / "data")
    for episode, seen in zip(found, frames, strict=True):
        assert set(episode.observations) == {"state", "image"}
        np.testing.assert_array_equal(episode.observations["image"], seen)
    assert found.observation_space["image"].contains(frames[0][0])


def test_robomimic_reads_a_run(run: Path, tmp_path: Path) -> None:
    path = exported(run, "robomimic", tmp_path / "x.hdf5")
    found = read_by_robomimic(path, ["state"], "final", next_observations=True)
    assert (found.n_demos, len(found)) == (2, 2 * STEPS)
    rows = [{name: np.concatenate([each[name] for each in logged(run)])} for name in ("action", "reward_used")]
    items = [found[index] for index in range(len(found))]
    np.testing.assert_array_equal([item["actions"][0] for item in items], rows[0]["action"])
    np.testing.assert_array_equal([item["rewards"][0] for item in items], rows[1]["reward_used"])
    assert [item["next_obs"]["state"][0, 0] - item["obs"]["state"][0, 0] for item in items] == [1] * (2 * STEPS)
    assert items[STEPS]["obs"]["state"][0, 0] == 100
    assert not any(item["dones"][0] for item in items)


def read_by_robomimic(path: Path, keys: list[str], split: str, next_observations: bool) -> SequenceDataset:
    specification = {"obs": {"low_dim": ["state", "environment_state"], "rgb": ["image"]}}
    robomimic_observations.initialize_obs_utils_with_obs_specs(specification)
    return SequenceDataset(
        str(path),
        obs_keys=keys,
        dataset_keys=["actions", "rewards", "dones"],
        load_next_obs=next_observations,
        hdf5_cache_mode=None,
        filter_by_attribute=split,
    )


def test_robomimic_images_and_simulator_states(run_dir: Path, tmp_path: Path, frames: list[np.ndarray]) -> None:
    path = exported(run_dir, "robomimic", tmp_path / "x.hdf5", images=True)
    item = read_by_robomimic(path, ["image"], "final", next_observations=True)[3]
    np.testing.assert_array_equal(item["obs"]["image"][0], frames[0][3])
    np.testing.assert_array_equal(item["next_obs"]["image"][0], frames[0][4])
    with h5py.File(path) as file:
        assert file["data"].attrs["total"] == 2 * STEPS
        environment = json.loads(file["data"].attrs["env_args"])
        assert (environment["env_name"], environment["env_type"]) == ("Lift", 1)
        assert environment["env_kwargs"]["robots"] == "Panda"
        states = file["data/demo_0/states"][()]
        np.testing.assert_allclose(np.diff(states[:, 0]), 0.05, atol=1e-9)  # time [s]
        initial = load_episode(run_dir, "final", 0).initial_state
        np.testing.assert_array_equal(states[0], initial[: states.shape[1]])
        assert file["mask/final"][()].tolist() == [b"demo_0", b"demo_1"]
    with h5py.File(exported(run_dir, "robomimic", tmp_path / "y.hdf5")) as file:
        np.testing.assert_array_equal(file["data/demo_0/states"][()], states)
        assert "image" not in file["data/demo_0/obs"]


def test_robomimic_plays_states_back(run_dir: Path, tmp_path: Path) -> None:
    """As robomimic's EnvRobosuite.reset_to does it, whose module needs more than is installed."""
    with h5py.File(exported(run_dir, "robomimic", tmp_path / "x.hdf5")) as file:
        settings = json.loads(file["data"].attrs["env_args"])["env_kwargs"]
        xml, states = file["data/demo_1"].attrs["model_file"], file["data/demo_1/states"][()]
    environment = robosuite.make("Lift", **settings)
    environment.reset()
    environment.reset_from_xml_string(environment.edit_model_xml(xml))
    environment.sim.reset()
    rows = load_episode(run_dir, "final", 1)
    for step in (0, STEPS - 2):
        environment.sim.set_state_from_flattened(states[step + 1])
        environment.sim.forward()
        cube = environment.sim.data.body_xpos[environment.cube_body_id]
        np.testing.assert_allclose(cube, rows.vector("cube_true")[step], atol=1e-6)
    environment.close()


def test_lerobot_rows(run: Path, tmp_path: Path) -> None:
    path = exported(run, "lerobot", tmp_path / "x")
    info = json.loads((path / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["fps"] == 20 and info["video_path"] is None
    assert (info["total_episodes"], info["total_frames"], info["splits"]) == (2, 2 * STEPS, {"train": "0:2"})
    table = pq.read_table(path / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(table.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        kind = table.schema.field(name).type
        size = [kind.list_size] if pa.types.is_fixed_size_list(kind) else [1]
        value = kind.value_type if pa.types.is_fixed_size_list(kind) else kind
        assert (size, str(value.to_pandas_dtype()().dtype)) == (feature["shape"], feature["dtype"])
    rows = logged(run)
    np.testing.assert_array_equal(table["action"].to_pylist(), np.concatenate([each["action"] for each in rows]))
    np.testing.assert_array_equal(table["next.reward"], np.concatenate([each["reward_used"] for each in rows]))
    assert table["index"].to_pylist() == list(range(2 * STEPS))
    assert [row[0] for row in table["observation.state"].to_pylist()] == [*range(STEPS), *range(100, 100 + STEPS)]
    np.testing.assert_allclose(table["timestamp"], [*np.arange(STEPS) / 20] * 2)
    assert np.flatnonzero(table["next.done"]).tolist() == [STEPS - 1, 2 * STEPS - 1]


def test_lerobot_meta(run: Path, tmp_path: Path) -> None:
    path = exported(run, "lerobot", tmp_path / "x")
    tasks = pd.read_parquet(path / "meta/tasks.parquet")  # as LeRobot does
    assert tasks.loc["Touch the cube with the end of the gripper."].task_index == 0
    episodes = pq.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in episodes] == [(0, 20), (20, 40)]
    assert {row["data/chunk_index"] for row in episodes} == {row["meta/episodes/file_index"] for row in episodes} == {0}
    statistics = json.loads((path / "meta/stats.json").read_text())
    actions = np.concatenate([each["action"] for each in logged(run)]).astype(np.float64)
    for name, expected in (("mean", actions.mean(0)), ("std", actions.std(0)), ("min", actions.min(0))):
        np.testing.assert_allclose(statistics["action"][name], expected, rtol=1e-6)
    assert statistics["action"]["count"] == [2 * STEPS]
    assert episodes[1]["stats/next.reward/count"] == [STEPS]


def test_lerobot_video_has_the_frames_in_the_order_of_the_rows(
    run_dir: Path, tmp_path: Path, frames: list[np.ndarray]
) -> None:
    path = exported(run_dir, "lerobot", tmp_path / "x", images=True)
    info = json.loads((path / "meta/info.json").read_text())
    key = CAMERA
    assert info["features"][key]["dtype"] == "video" and info["features"][key]["shape"] == [64, 64, 3]
    episodes = pq.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    spans = [(row[f"videos/{key}/from_timestamp"], row[f"videos/{key}/to_timestamp"]) for row in episodes]
    assert spans == [(0.0, 1.0), (1.0, 2.0)]
    with av.open(str(path / info["video_path"].format(video_key=key, chunk_index=0, file_index=0))) as video:
        decoded = [(float(frame.pts * frame.time_base), frame.to_ndarray(format="rgb24")) for frame in video.decode()]
    np.testing.assert_allclose([at for at, _ in decoded], np.arange(2 * STEPS) / 20)
    shown = np.stack([image for _, image in decoded]).astype(int)
    rendered = np.concatenate([each[:STEPS] for each in frames]).astype(int)
    assert np.abs(shown - rendered).mean() < 3  # of 255: colour is stored at half the resolution
    nearest = [np.abs(rendered - image).mean(axis=(1, 2, 3)).argmin() for image in shown]
    assert nearest == list(range(2 * STEPS))
    statistics = json.loads((path / "meta/stats.json").read_text())[key]
    expected = rendered.mean(axis=(0, 1, 2))[:, None, None] / 255
    np.testing.assert_allclose(statistics["mean"], expected, rtol=1e-9)


def test_lerobot_begins_another_file_when_one_is_full(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot_files, "DATA_MB", 0)
    monkeypatch.setattr(lerobot_files, "VIDEO_MB", 0)
    monkeypatch.setattr(lerobot_files, "FILES_IN_CHUNK", 1)
    path = exported(run_dir, "lerobot", tmp_path / "x", images=True)
    names = ("data/chunk_index", f"videos/{CAMERA}/chunk_index", f"videos/{CAMERA}/from_timestamp")
    episodes = pq.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [[row[name] for name in names] for row in episodes] == [[0, 0, 0.0], [1, 1, 0.0]]
    assert set(pq.read_table(path / "data/chunk-001/file-000.parquet")["episode_index"].to_pylist()) == {1}
    with av.open(str(path / f"videos/{CAMERA}/chunk-001/file-000.mp4")) as video:
        assert sum(1 for _ in video.decode()) == STEPS


def test_image_statistics_are_those_of_the_bytes() -> None:
    images = np.random.default_rng(0).integers(0, 256, (3, 5, 7, 3), np.uint8)
    found = lerobot_stats.of_images(images)
    pixels = images.reshape(-1, 3) / 255
    for name, expected in (("min", pixels.min(0)), ("max", pixels.max(0)), ("std", pixels.std(0))):
        np.testing.assert_allclose(found[name], expected[:, None, None])
    assert found["q50"].shape == (3, 1, 1)
    np.testing.assert_allclose(found["q50"].ravel(), np.median(pixels, axis=0), atol=0.02)


def test_a_dataset_is_its_frames(dataset_dir: Path, tmp_path: Path, frames: list[np.ndarray]) -> None:
    path = exported(dataset_dir, "robomimic", tmp_path / "x.hdf5", images=True)
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        np.testing.assert_array_equal(demo["obs/image"][()], frames[0][:STEPS])
        assert demo["steps"][()].tolist() == list(range(STEPS))
        assert demo["obs/state"].shape == (STEPS, 14) and "next_obs" not in demo
        assert file["mask/test"][()].tolist() == [b"demo_0"]
    cubes = pq.read_table(dataset_dir / "frames.parquet").select(["cube_x", "cube_y", "cube_z"]).to_pandas()
    table = pq.read_table(exported(dataset_dir, "lerobot", tmp_path / "l") / "data/chunk-000/file-000.parquet")
    seen = np.array(table["observation.environment_state"].to_pylist())[:, :3]
    np.testing.assert_allclose(seen, cubes.to_numpy()[:STEPS], rtol=1e-6)
    assert "next.reward" not in table.column_names
    episode = minari.MinariDataset(exported(dataset_dir, "minari", tmp_path / "m", images=True) / "data")[0]
    np.testing.assert_array_equal(episode.observations["image"], frames[0][:STEPS])
    assert len(episode.actions) == STEPS - 1 and not episode.rewards.any()


def test_which_episodes(run_dir: Path, dataset_dir: Path) -> None:
    assert open_source(run_dir, "minari", "final", 1, images=False).total == 1
    assert [each.number for each in open_source(run_dir, "minari", None, None, images=False).read()] == [0, 1]
    with pytest.raises(ConfigError, match="has no episode of the split train; there: final"):
        open_source(run_dir, "minari", "train", None, images=False)
    with pytest.raises(ConfigError, match="unknown split 'test'; valid: eval, final, train"):
        open_source(run_dir, "minari", "test", None, images=False)
    with pytest.raises(ConfigError, match="unknown split 'final'; valid: test, train, validation"):
        open_source(dataset_dir, "minari", "final", None, images=False)
    with pytest.raises(ConfigError, match="has no episode of the split train"):
        open_source(dataset_dir, "minari", "train", None, images=False)


def test_a_run_without_estimator_has_no_estimates(fresh_run: Callable[..., Path]) -> None:
    run_dir = fresh_run()
    config = json.loads((run_dir / "manifest.json").read_text())["config"]
    edit_manifest(run_dir, config=config | {"estimator": None})
    signals = next(open_source(run_dir, "minari", None, None, images=False).read()).signals
    assert "cube_est" not in signals and "reward_dense_est" not in signals and "cube_true" in signals


def test_episodes_are_told_apart_within_a_part(run: Path) -> None:
    parts = sorted((run / "transitions").glob("*.parquet"))
    before = logged(run)
    pq.write_table(pa.concat_tables(map(pq.read_table, parts)), parts[0], row_group_size=7)
    parts[1].unlink()
    after = list(open_source(run, "minari", None, None, images=False).read())
    assert [episode.number for episode in after] == [0, 1]
    for episode, rows in zip(after, before, strict=True):
        np.testing.assert_array_equal(episode.actions, rows["action"])


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_nothing_is_left_of_what_was_interrupted(
    form: Format, error: type[BaseException], run_dir: Path, tmp_path: Path
) -> None:
    class Interrupting(Silent):
        def task(self, label: str, total: int, done: int = 0) -> Any:
            return self

        def __enter__(self) -> "Interrupting":
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def advance(self, units: int = 1) -> None:
            assert not (tmp_path / "x").exists()
            raise error("no more")

    with pytest.raises((KeyboardInterrupt, Exception), match="no more"):
        export(open_source(run_dir, "minari", None, None, images=False), form, tmp_path / "x", Interrupting())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", FORMATS)
def test_a_damaged_run_leaves_nothing(form: Format, fresh_run: Callable[..., Path], tmp_path: Path) -> None:
    run_dir = fresh_run()
    tamper(run_dir, "step", 3, lambda step: step + 1, part=1)
    (tmp_path / "out").mkdir()
    with pytest.raises(ArtifactError, match="the logs are incomplete"):
        exported(run_dir, form, tmp_path / "out" / "x")
    assert list((tmp_path / "out").iterdir()) == []


def test_the_target_must_be_absent_and_its_directory_there(run_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "x").write_text("mine")
    with pytest.raises(ConfigError, match="x is there already: remove it or name another place with -o"):
        exported(run_dir, "robomimic", tmp_path / "x")
    assert (tmp_path / "x").read_text() == "mine"
    with pytest.raises(ConfigError, match="there is no directory"):
        exported(run_dir, "robomimic", tmp_path / "no" / "x")


def test_what_is_no_run(fresh_run: Callable[..., Path]) -> None:
    run_dir = fresh_run()
    edit_manifest(run_dir, stage="analyze")
    with pytest.raises(ArtifactError, match="is an artifact of analyze, not a run"):
        open_source(run_dir, "minari", None, None, images=False)
    edit_manifest(run_dir, stage="train-policy")
    row = pq.read_table(run_dir / "episodes.parquet").slice(1, 1)
    pq.write_table(pa.Table.from_pylist(row.to_pylist(), schema=EPISODES), run_dir / "episodes.parquet")
    with pytest.raises(ArtifactError, match=r"has an episode that episodes\.parquet does not name"):
        list(open_source(run_dir, "minari", None, 2, images=False).read())


def test_images_of_another_trajectory_are_refused(fresh_run: Callable[..., Path], tmp_path: Path) -> None:
    run_dir = fresh_run()
    tamper(run_dir, "eef_x", 5, lambda x: x + 0.001)
    with pytest.raises(ArtifactError, match="does not replay: eef differs, first at step 5"):
        exported(run_dir, "minari", tmp_path / "x", images=True)
    assert list(tmp_path.iterdir()) == [tmp_path / "data"]
