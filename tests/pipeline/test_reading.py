"""view, replay and sql: what they hand to the rooms, and what they make of the answer."""

import csv
import json
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from pipeline.artifacts.inputs import input_ref
from pipeline.artifacts.store import Build, Request, Store
from pipeline.camera_views import write_camera_views
from schemas.errors import ArtifactError, MachineError
from schemas.tables import FRAMES
from stages.collect.config import CollectStageConfig
from stages.replay.frames import View
from stages.sim.camera import CameraPose, nominal_pose
from stages.sim.config import CameraConfig
from tests.pipeline.fakes import Run, refused

CELL = "runs/small/reach-dense-orbit05-seed0"
FRAME = {"dataset": "small", "episode": 3, "step": 7, "time_ns": 350, "file": "episodes/episode-000003.mcap"}


def made(store: Store, artifact_id: str, config: dict[str, Any], *inputs: str) -> Path:
    """A complete artifact with a Parquet file of frames."""
    begun = store.begin(Request(artifact_id, config, [input_ref(store.root, each) for each in inputs]), resume=False)
    assert isinstance(begun, Build)
    with begun as build:
        frames = pa.Table.from_pylist([{**FRAME, "split": "train"}, {**FRAME, "step": 8, "split": "test"}], FRAMES)
        pq.write_table(frames, build.path / "frames.parquet")
        build.finish({"episodes": 4, "frames": 2})
    return store.path(artifact_id)


@pytest.fixture
def family(store: Store) -> Store:
    """dataset → estimator → run."""
    made(store, "datasets/small", CollectStageConfig().model_dump(mode="json"))
    made(store, "estimators/small", {"perception": {"test_misalignments": [10.0, 5.0]}}, "datasets/small")
    identity = {"misalignment_kind": "orbit", "misalignment_deg": 5.0}
    made(store, CELL, {"estimator": "small", "run": identity}, "estimators/small")
    return store


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Calls of the replay room, which writes a file instead of a recording."""
    calls: list[tuple[Any, ...]] = []

    def record(*given: Any) -> Any:
        calls.append(given)
        given[-1].write_bytes(b"rrd")
        return 12

    def record_episode(*given: Any) -> Any:
        record(*given)
        differs = given[2] == 4
        return SimpleNamespace(identical=not differs, message=lambda: "eef differs")

    monkeypatch.setattr("stages.replay.recording.record_episode", record_episode)
    monkeypatch.setattr("stages.replay.dataset_recording.record_dataset_episode", record)
    monkeypatch.setattr("stages.replay.estimator_recording.record_estimator", record)
    return calls


def test_view_saves_what_shows_each_kind(run: Run, family: Store, recorded: list[Any], tmp_path: Path) -> None:
    save = tmp_path / "x.rrd"
    shown = run("view", CELL, "--split", "eval", "--episode", "3", "--save", save, "--json")
    assert json.loads(shown.stdout) == {
        **{"artifact": CELL, "split": "eval", "episode": 3, "recording": str(save)},
        **{"identical": True, "warning": None},
    }
    assert run("view", "datasets/small", "--episode", "1", "--save", save).exit_code == 0
    assert run("view", "estimators/small", "--save", save).exit_code == 0
    dataset = family.path("datasets/small")
    assert recorded == [
        (family.path(CELL), "eval", 3, save),
        (dataset, 1, save),
        (family.path("estimators/small"), dataset, save),
    ]


def test_view_warns_of_a_replay_that_differs(run: Run, family: Store, recorded: list[Any], tmp_path: Path) -> None:
    shown = run("view", CELL, "--episode", "4", "--save", tmp_path / "x.rrd", "--json")
    assert (shown.exit_code, json.loads(shown.stdout)["identical"]) == (0, False)
    assert shown.stderr == "Warning: the picture is of another trajectory than the logs: eef differs\n"


def test_view_of_a_report_is_its_learning_curves(run: Run, store: Store, tmp_path: Path) -> None:
    report = made(store, "reports/small", {})
    assert "it is on no runs" in run("view", "reports/small", "--save", tmp_path / "x.rrd").stderr
    (report / "comparison.rrd").write_bytes(b"curves")
    assert run("view", "reports/small", "--save", tmp_path / "x.rrd").exit_code == 0
    assert (tmp_path / "x.rrd").read_bytes() == b"curves"


def test_view_opens_a_window(run: Run, family: Store, recorded: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[Path, bytes]] = []

    def opened(path: Path) -> Any:
        return SimpleNamespace(wait=lambda: shown.append((path, path.read_bytes())))

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("stages.replay.viewer.open_viewer", opened)
    monkeypatch.setattr("stages.replay.viewer.stop_viewer", lambda process: None)
    assert run("view", "datasets/small").exit_code == 0
    [(path, content)] = shown
    assert content == b"rrd", "the file is there until the window is closed"
    assert not path.parent.exists()


def test_view_without_a_display_does_nothing(
    run: Run, family: Store, recorded: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = run("view", "datasets/small")
    assert (result.exit_code, "no display" in result.stderr) == (4, sys.platform == "linux")
    assert recorded == []


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("datasets/none",), 3, "datasets/none does not exist"),
        (("small",), 2, "ambiguous"),
        (("datasets/small", "--save", "x.mp4"), 2, "a Rerun recording ends in .rrd"),
        (("datasets/small", "--save", "no/where/x.rrd"), 2, "there is no directory no/where"),
        (("datasets/small", "--episode", "-1"), 2, "-1"),
    ],
)
def test_view_refusals(run: Run, family: Store, arguments: tuple[str, ...], code: int, message: str) -> None:
    result = run("view", *arguments)
    assert (result.exit_code, message in result.stderr) == (code, True), result.stderr


@pytest.fixture
def replayed(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The replay room's answer, and what it was asked."""
    fake = SimpleNamespace(asked=None, error=None)

    def proof(path: Path, split: str, episode: int) -> Any:
        def require_identical() -> None:
            if fake.error:
                raise ArtifactError(fake.error)

        fake.asked = (path, split, episode)
        as_dict = {"identical": True, "steps": 200}
        return SimpleNamespace(
            require_identical=require_identical,
            as_dict=lambda: as_dict,
            message=lambda: "200 steps replayed, identical",
            steps_per_second=1000.0,
        )

    def export(path: Path, split: str, episode: int, save: Path, view: View, eye: Any) -> Any:
        save.write_text(f"{view.image_size}")
        return proof(path, split, episode), eye

    monkeypatch.setattr("stages.replay.proof.replay", proof)
    monkeypatch.setattr("stages.replay.export.export_episode", export)
    return fake


def test_replay(run: Run, family: Store, replayed: SimpleNamespace) -> None:
    short = CELL.removeprefix("runs/")
    shown = run("replay", short, "--split", "train", "--episode", "5")
    assert "200 steps replayed, identical" in shown.stdout
    assert replayed.asked == (family.path(CELL), "train", 5)
    assert json.loads(run("replay", short, "--episode", "5", "--json").stdout)["identical"] is True


def test_replay_saves_in_the_format_of_the_name(
    run: Run, family: Store, replayed: SimpleNamespace, tmp_path: Path
) -> None:
    save = tmp_path / "x.mp4"
    shown = run("replay", CELL, "--episode", "5", "--save", save, "--image-size", "512", "--json")
    assert json.loads(shown.stdout)["saved"] == str(save)
    assert save.read_text() == "512"
    wrong = run("replay", CELL, "--episode", "5", "--save", tmp_path / "x.avi")
    assert wrong.exit_code == 2
    assert ".mcap, .mp4, .rrd" in wrong.stderr


def test_a_replay_that_differs_is_an_error(run: Run, family: Store, replayed: SimpleNamespace) -> None:
    replayed.error = "from step 7 on eef differs"
    result = run("replay", CELL, "--episode", "5")
    assert (result.exit_code, result.stderr) == (3, "Error: from step 7 on eef differs\n")


def test_replay_is_of_runs_only(run: Run, family: Store) -> None:
    assert run("replay", "datasets/small", "--episode", "0").exit_code == 3
    assert run("replay", CELL).exit_code == 2


# sql


def test_sql_formats(run: Run, family: Store, tmp_path: Path) -> None:
    question = "SELECT episode, step FROM frames ORDER BY step"
    assert run("sql", question, "--format", "csv").stdout == "episode,step\n3,7\n3,8\n"
    assert json.loads(run("sql", question, "--format", "json").stdout) == [
        {"episode": 3, "step": 7},
        {"episode": 3, "step": 8},
    ]
    assert json.loads(run("sql", question, "--json").stdout)["rows"][1] == {"episode": 3, "step": 8}
    assert run("sql", question).stdout.split() == ["episode", "step", "───────", "────", "3", "7", "3", "8"]
    for name in ("a.parquet", "a.csv"):  # the name says the format
        assert run("sql", question, "-o", tmp_path / name).exit_code == 0
    assert pq.read_table(tmp_path / "a.parquet")["step"].to_pylist() == [7, 8]
    assert list(csv.reader((tmp_path / "a.csv").open())) == [["episode", "step"], ["3", "7"], ["3", "8"]]


def test_sql_files_and_their_formats(run: Run, family: Store, tmp_path: Path) -> None:
    refused(run("sql", "SELECT 1", "-o", tmp_path / "x.txt"), 2, "a file ends in .csv, .json or .parquet")
    cut = run("sql", "FROM range(150)", "-o", tmp_path / "x.txt", "--format", "table")
    assert (cut.exit_code, cut.stdout) == (0, "")
    assert "has the first 100 of 150 rows: --format csv, json or parquet has all" in cut.stderr
    refused(run("sql", "SELECT 1", "-o", "/proc/x.csv"), 4, "cannot write /proc/x.csv")


def test_sql_as_one_object_streams_or_fails_whole(run: Run, family: Store) -> None:
    assert len(json.loads(run("sql", "FROM range(25000)", "--json").stdout)["rows"]) == 25_000
    wrong = json.loads(run("sql", "SELECT nope", "--json").stdout)
    assert wrong["error"]["exit_code"] == 2 and "nope" in wrong["error"]["message"]


def test_a_reader_that_has_enough_is_no_failure(family: Store) -> None:
    command = f"{sys.executable} -m pipeline sql 'FROM range(1000000)' --format csv --data {family.root}"
    read = subprocess.run(
        ["bash", "-c", f"{command} | head -2; exit ${{PIPESTATUS[0]}}"], capture_output=True, text=True, check=True
    )
    assert (read.stdout, read.stderr) == ("range\n0\n", "")


def test_sql_from_stdin(run: Run, family: Store) -> None:
    for arguments in ((), ("-",)):
        assert run("sql", *arguments, "--format", "csv", input="SELECT 1 AS n").stdout == "n\n1\n"
    refused = run("sql", "-", input=b"SELECT '\xff'")
    assert (refused.exit_code, "cannot read stdin" in refused.stderr) == (2, True)


def test_sql_schema(run: Run, tmp_path: Path) -> None:
    shown = run("sql", "--schema").stdout
    assert "reward_dense_est" in shown and "return_by_scheme()" in shown
    one = json.loads(run("sql", "--schema", "updates", "--json").stdout)
    assert list(one["views"]) == ["updates"] and one["macros"] == []
    macro = run("sql", "--schema", "iqm").stdout
    assert "Interquartile" in macro and "episodes" not in macro
    wrong = run("sql", "--schema", "update")
    assert (wrong.exit_code, "unknown view or macro 'update'; valid:" in wrong.stderr) == (2, True)


def test_sql_from_a_file(run: Run, family: Store, tmp_path: Path) -> None:
    question = tmp_path / "question.sql"
    assert run("sql", question).exit_code == 2
    question.write_text("SELECT count(*) AS n FROM runs")
    assert run("sql", question, "--format", "csv").stdout == "n\n1\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("DROP TABLE runs",), "read-only"),
        (("SELECT nothing FROM runs",), "nothing"),
        (("SELECT 1", "--format", "xml"), "xml"),
        (("SELECT 1", "--format", "parquet"), "-o FILE.parquet"),
        (("SELECT 1", "--json", "--format", "csv"), "--json prints one object"),
    ],
)
def test_sql_refusals(run: Run, family: Store, arguments: tuple[str, ...], message: str) -> None:
    result = run("sql", *arguments)
    assert result.exit_code == 2, result.output
    assert message in (result.stderr + result.stdout)


def test_sql_needs_a_data_root(run: Run) -> None:
    result = run("sql", "SELECT 1")
    assert result.exit_code == 3
    assert "no data root" in result.stderr


# The report's camera views


def test_camera_views_show_every_tested_turn_of_one_scene(
    family: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, Any]] = []

    class Renderer(nullcontext[None]):
        def __init__(self, scene: str, size: int, fovy: float) -> None:
            assert (scene, size, fovy) == ("scene", 320, 43.0)

        def __enter__(self) -> Any:
            return self

        def render(self, qpos: np.ndarray, pose: CameraPose) -> np.ndarray:
            asked.append((qpos.tolist(), pose))
            return np.full((320, 320, 3), 7, np.uint8)

    monkeypatch.setattr("stages.sim.renderer.Renderer", Renderer)
    monkeypatch.setattr("stages.sim.scene.build_scene", lambda world: "scene")
    monkeypatch.setattr("pipeline.camera_views._test_scene", lambda path: np.zeros(2))
    write_camera_views(family, ["estimators/small"], tmp_path / "figures")
    turns = {"0°", "orbit 5°", "orbit 10°", "pan 5°", "pan 10°"}
    assert {path.stem.removeprefix("camera-") for path in (tmp_path / "figures").iterdir()} == turns
    assert Image.open(tmp_path / "figures" / "camera-pan 5°.png").size == (320, 320)
    assert all(qpos == [0.0, 0.0] for qpos, _ in asked)
    nominal = nominal_pose(CameraConfig())
    assert [np.allclose(pose.position, nominal.position) for _, pose in asked] == [True, False, False, True, True]


@pytest.mark.parametrize("broken", ["pipeline.camera_views.require_sim", "stages.sim.scene.build_scene"])
def test_a_report_does_without_camera_views(
    family: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    def no_gl(*given: Any) -> Any:
        raise MachineError("no OpenGL")

    monkeypatch.setattr("pipeline.camera_views._test_scene", lambda path: np.zeros(2))
    monkeypatch.setattr(broken, no_gl)
    write_camera_views(family, ["estimators/small"], tmp_path / "figures")
    write_camera_views(family, [], tmp_path / "figures")
    assert not list(tmp_path.rglob("*.png"))
