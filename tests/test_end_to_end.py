"""The whole pipeline through its command line, everything real and very small."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import duckdb
import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from schemas import tables
from schemas.mcap_files import read_messages
from schemas.mcap_topics import CAMERA_IMAGE

HORIZON, TRAIN, FINAL = 15, 4, 2
SCHEMES = ("dense", "sparse", "oracle", "dense2sparse")
SMALL = {
    "world.horizon": HORIZON,
    "collect.episodes": 12,
    "collect.steps": 8,
    "perception.epochs": 1,
    "policy.schemes": list(SCHEMES),
    "policy.episodes": TRAIN,
    "policy.warmup_episodes": 1,
    "policy.switch_episode": 3,
    "policy.eval_every": 2,
    "policy.eval_episodes": 1,
    "policy.final_episodes": FINAL,
    "policy.checkpoint_every": 1,
    "policy.misalignment_degrees": [5.0],
    "analyze.bootstrap_samples": 100,
}
SETTINGS = [part for key, value in SMALL.items() for part in ("--set", f"{key}={json.dumps(value)}")]


def _without_network() -> list[str]:
    """What to put before a command so that the kernel gives it none: nothing of the pipeline needs one."""
    candidates = (["unshare", "--net"], ["unshare", "--net", "--map-root-user"])
    reach = [sys.executable, "-c", "import socket; socket.create_connection(('127.0.0.1', 9))"]
    for prefix in candidates if shutil.which("unshare") else ():
        if "unreachable" in subprocess.run([*prefix, *reach], capture_output=True, text=True).stderr:
            return prefix
    return []


ALONE = _without_network()


def _command(root: Path, *arguments: str) -> list[str]:
    return [*ALONE, sys.executable, "-m", "pipeline", *arguments, "--data", str(root)]


def _pipeline(root: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = _command(root, *arguments)
    return subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, **environment})


def _answer(root: Path, *arguments: str) -> dict:
    done = _pipeline(root, *arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root with everything of one small study."""
    root = tmp_path_factory.mktemp("end-to-end") / "data"
    _answer(root, "run", "demo", "--name", "tiny", *SETTINGS)
    return root


def _cell(scheme: str) -> str:
    return f"tiny/reach-{scheme}-orbit05-seed0"


def _query(root: Path, sql: str) -> list[tuple]:
    done = _pipeline(root, "sql", sql, "--format", "csv")
    assert done.returncode == 0, done.stderr
    return duckdb.read_csv(_as_file(root, done.stdout)).fetchall()


def _as_file(root: Path, text: str) -> str:
    path = root.parent / "answer.csv"
    path.write_text(text)
    return str(path)


def test_every_artifact_is_complete_and_nothing_temporary_is_left(root: Path) -> None:
    listed = {item["id"]: item["status"] for item in _answer(root, "list")["artifacts"]}
    expected = {"datasets/tiny", "estimators/tiny", "reports/tiny", *(f"runs/{_cell(scheme)}" for scheme in SCHEMES)}
    assert listed == dict.fromkeys(expected, "complete")
    assert not [path for path in root.rglob("*") if path.name.endswith(".tmp")]


@pytest.mark.skipif(not ALONE, reason="no process can be cut off from the network here")
def test_nothing_needed_a_network(root: Path) -> None:
    """All commands of this file ran without; that they had none is what choosing `ALONE` found."""
    assert _answer(root, "show", "reports/tiny")["status"] == "complete"


def test_the_logs_hold_every_step_of_every_split(root: Path) -> None:
    rows = _query(root, "SELECT run, split, count(*)::INT FROM transitions GROUP BY ALL ORDER BY ALL")
    steps = {"train": TRAIN * HORIZON, "eval": TRAIN // 2 * HORIZON, "final": FINAL * HORIZON}
    assert rows == [(_cell(scheme), split, steps[split]) for scheme in sorted(SCHEMES) for split in sorted(steps)]


def test_parquet_has_exactly_the_columns_of_the_contract(root: Path) -> None:
    for scheme in SCHEMES:
        for part in (root / "runs" / _cell(scheme) / "transitions").glob("*.parquet"):
            assert pq.read_schema(part).equals(tables.transitions(24, 7))


def test_each_scheme_was_given_its_reward(root: Path) -> None:
    sql = """SELECT scheme, episode >= 3 AS late, bool_and(reward_used = reward_dense_est) AS est,
             bool_and(reward_used = reward_dense_true) AS truth, bool_and(reward_used = reward_sparse) AS sparse
             FROM transitions WHERE split = 'train' GROUP BY ALL ORDER BY ALL"""
    found = {(scheme, late): (est, truth, sparse) for scheme, late, est, truth, sparse in _query(root, sql)}
    assert found["dense", True][0]
    assert found["oracle", True][1]
    assert found["sparse", False][2]
    assert found["dense2sparse", False][0]
    assert found["dense2sparse", True][2] and not found["dense2sparse", True][0]


def test_until_the_switch_dense2sparse_is_dense(root: Path) -> None:
    """Same seed, same rewards so far: the same bytes. What differs later is due to the reward alone."""
    sql = """SELECT episode, episode < 3 AS early, bool_and(a.action = b.action AND a.observation = b.observation)
             FROM transitions a JOIN transitions b USING (split, episode, step)
             WHERE a.scheme = 'dense' AND b.scheme = 'dense2sparse' AND split = 'train' GROUP BY ALL"""
    assert [same for _, early, same in _query(root, sql) if early] == [True] * 3


def test_the_estimate_is_logged_beside_the_truth(root: Path) -> None:
    """For every scheme, the oracle's too; the error is the distance between the two."""
    sql = """SELECT count(*) FILTER (cube_est_x IS NULL), avg(estimation_error), max(abs(estimation_error -
             sqrt(pow(cube_est_x - cube_true_x, 2) + pow(cube_est_y - cube_true_y, 2)
             + pow(cube_est_z - cube_true_z, 2)))) FROM transitions"""
    [(missing, mean, difference)] = _query(root, sql)
    assert missing == 0 and difference < 1e-6 and mean > 0.001


def test_a_logged_episode_replays_identically(root: Path) -> None:
    for scheme, split, episode in (("dense2sparse", "train", 3), ("oracle", "final", 1)):
        result = _answer(root, "replay", _cell(scheme), "--split", split, "--episode", str(episode))
        assert result["identical"] is True


def test_an_episode_estimated_again_by_its_own_estimator_is_what_was_logged(root: Path) -> None:
    for scheme in ("dense", "oracle"):
        result = _answer(root, "replay", _cell(scheme), "--episode", "1", "--estimator", "tiny")["what_if"]
        assert result["moved"] < 1e-5
        assert result["return_dense_est"] == pytest.approx(result["return_dense_est_logged"], abs=1e-3)
    turned = _answer(root, "replay", _cell("dense"), "--episode", "1", "--misalignment", "60")["what_if"]
    assert turned["moved"] > 0.001 and turned["estimated_by"] == "tiny from orbit 60°"


def test_new_labels_by_the_same_estimator_are_the_old_ones(root: Path) -> None:
    [cell] = _answer(root, "relabel", _cell("dense"), "--scheme", "dense", "--estimator", "tiny")["cells"]
    assert cell["id"] == "relabels/tiny-dense-tiny/reach-dense-orbit05-seed0-as-dense"
    sql = f"""SELECT count(*), max(abs(a.reward_used - b.reward_used)),
              max(list_max(list_transform(range(1, 25), lambda i: abs(a.observation[i] - b.observation[i]))))
              FROM transitions a JOIN relabelled_transitions b USING (split, episode, step)
              WHERE a.run = '{_cell("dense")}'"""
    [(count, reward, observation)] = _query(root, sql)
    assert count == (TRAIN + TRAIN // 2 + FINAL) * HORIZON
    assert reward < 1e-4 and observation < 1e-4


def test_runs_that_differ_in_the_scheme_are_labelled_side_by_side(root: Path) -> None:
    labels = ("--scheme", "dense2sparse", "--switch-episode", "2", "--name", "early")
    done = _answer(root, "relabel", _cell("dense"), _cell("sparse"), *labels)
    assert [cell["id"].rpartition("/")[2] for cell in done["cells"]] == [
        f"reach-{scheme}-orbit05-seed0-as-dense2sparse" for scheme in ("dense", "sparse")
    ]
    refused = _pipeline(root, "relabel", "tiny", *labels)  # the oracle saw the truth
    assert refused.returncode == 2 and "name with --estimator who makes them" in refused.stderr
    rows = _query(root, "SELECT source, relabel FROM relabels JOIN relabelled_episodes USING (relabel) GROUP BY ALL")
    assert (_cell("dense"), "early/reach-dense-orbit05-seed0-as-dense2sparse") in rows


def test_learning_from_logs_alone(root: Path) -> None:
    sparse = _answer(root, "relabel", _cell("dense"), "--scheme", "sparse", "--name", "as-sparse")["cells"][0]["id"]
    arguments = ["train-policy", "--profile", "demo", "--name", "from-logs", "--offline", sparse, *SETTINGS]
    [cell] = _answer(root, *arguments, "--set", "policy.td3.behaviour_cloning=2.5")["cells"]
    assert cell["id"] == "runs/from-logs/reach-sparse-orbit05-seed0"
    counts = dict(_query(root, "SELECT split, count(*)::INT FROM episodes WHERE run LIKE 'from-logs/%' GROUP BY ALL"))
    assert counts == {"eval": TRAIN // 2, "final": FINAL}
    lineage = [each["id"] for each in _answer(root, "show", cell["id"])["lineage"]["inputs"]]
    assert lineage == ["estimators/tiny", sparse]


def test_a_tampered_log_is_found_out(root: Path, tmp_path: Path) -> None:
    copy = tmp_path / "data"
    shutil.copytree(root, copy)
    part = copy / "runs" / _cell("dense") / "transitions" / "part-00000.parquet"
    part.write_bytes(part.read_bytes()[:-100])
    done = _pipeline(copy, "replay", _cell("dense"), "--split", "train", "--episode", "0")
    assert done.returncode == 3 and part.name in done.stderr and "Traceback" not in done.stderr


def test_recorded_frames_are_what_a_replay_renders(root: Path, tmp_path: Path) -> None:
    """Every second episode with what the camera saw; the same pictures, pixel for pixel, as rendered afterwards."""
    arguments = ["train-policy", "--profile", "demo", "--name", "recorded", "--estimator", "tiny", *SETTINGS]
    only = ["--set", "policy.record_every=2", "--set", "policy.schemes=['dense']"]
    assert _answer(root, *arguments, *only)["cells"][0]["did"] == "made"
    run = root / "runs/recorded/reach-dense-orbit05-seed0"
    names = sorted(path.name for path in (run / "recordings").iterdir())
    assert names == [
        f"{split}-{number:06d}.mcap" for split, number in (("eval", 0), ("final", 0), ("train", 0), ("train", 2))
    ]
    replayed = tmp_path / "replayed.mcap"
    cell = "recorded/reach-dense-orbit05-seed0"
    assert (
        _pipeline(root, "replay", cell, "--split", "train", "--episode", "2", "--save", str(replayed)).returncode == 0
    )
    pictures = [
        [np.asarray(Image.open(io.BytesIO(m.data))) for _, _, m in read_messages(path, CAMERA_IMAGE)]
        for path in (run / "recordings/train-000002.mcap", replayed)
    ]
    assert len(pictures[0]) == HORIZON + 1
    np.testing.assert_array_equal(pictures[0], pictures[1])
    saved, blind = tmp_path / "view.rrd", {"MUJOCO_GL": "disabled"}
    viewed = _pipeline(root, "view", cell, "--split", "train", "--episode", "2", "--save", str(saved), **blind)
    assert viewed.returncode == 0, viewed.stderr  # nothing is rendered again


@pytest.mark.parametrize("artifact", ["datasets/tiny", "estimators/tiny", f"runs/{_cell('dense')}"])
def test_a_recording_is_saved(root: Path, tmp_path: Path, artifact: str) -> None:
    path = tmp_path / "view.rrd"
    done = _pipeline(root, "view", artifact, "--episode", "0", "--save", str(path))
    assert done.returncode == 0, done.stderr
    assert path.read_bytes()[:3] == b"RRF" and path.stat().st_size > 50_000


def test_several_runs_show_their_learning_curves(root: Path, tmp_path: Path) -> None:
    whole, two = tmp_path / "all.rrd", tmp_path / "two.rrd"
    assert _answer(root, "view", "runs/tiny", "--save", str(whole))["runs"] == len(SCHEMES)
    assert _answer(root, "view", _cell("dense"), _cell("sparse"), "--save", str(two))["runs"] == 2
    assert whole.stat().st_size > two.stat().st_size > 1000


def test_the_report_stands_alone(root: Path) -> None:
    report = (root / "reports" / "tiny" / "report.html").read_text()
    for scheme in SCHEMES:
        assert scheme in report
    assert "<script src=" not in report and "<link" not in report


def test_lineage_leads_back_to_the_dataset(root: Path) -> None:
    done = _pipeline(root, "show", "reports/tiny")
    assert done.returncode == 0 and "datasets/tiny" in done.stdout and "estimators/tiny" in done.stdout


def test_the_estimator_was_tested_under_every_misalignment(root: Path) -> None:
    sql = "SELECT DISTINCT misalignment_kind, misalignment_deg::INT FROM predictions ORDER BY ALL"
    assert _query(root, sql) == [("none", 0), ("orbit", 5), ("orbit", 10), ("pan", 5), ("pan", 10)]


def test_asking_again_does_nothing(root: Path) -> None:
    before = {
        path: path.stat().st_mtime_ns for path in root.rglob("*") if path.is_file() and ".locks" not in path.parts
    }
    done = _pipeline(root, "run", "demo", "--name", "tiny", *SETTINGS)
    assert done.returncode == 0, done.stderr
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_another_config_under_the_same_name_is_refused(root: Path) -> None:
    done = _pipeline(root, "collect", "--profile", "demo", "--name", "tiny", "--set", "collect.seed=9")
    assert done.returncode == 2 and "--name" in done.stderr


def test_killed_and_resumed_equals_uninterrupted(root: Path) -> None:
    """SIGKILL after the first checkpoint, with real worlds: the resumed logs and weights are the same."""
    arguments = ["train-policy", "--profile", "demo", "--name", "killed", "--estimator", "tiny", *SETTINGS]
    with subprocess.Popen(_command(root, *arguments), stderr=subprocess.DEVNULL) as process:
        checkpoints = root / "runs/killed/reach-oracle-orbit05-seed0/checkpoints"
        deadline = time.monotonic() + 120
        while not list(checkpoints.glob("000002-*")) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL, "it was still running"
    refused = _pipeline(root, *arguments)
    assert refused.returncode == 2 and "--resume" in refused.stderr
    assert _pipeline(root, *arguments, "--resume").returncode == 0
    for scheme in SCHEMES:
        whole, resumed = (root / "runs" / name / f"reach-{scheme}-orbit05-seed0" for name in ("tiny", "killed"))
        _assert_same_logs(whole, resumed)
        weights = Path("checkpoints") / "policy.safetensors"
        assert (whole / weights).read_bytes() == (resumed / weights).read_bytes()


def _assert_same_logs(whole: Path, resumed: Path) -> None:
    patterns: Sequence[str] = ("transitions/*.parquet", "episodes.parquet", "evaluations.parquet", "updates.parquet")
    for pattern in patterns:
        one, other = (
            [row | {"run": "", "wall_time_s": 0} for path in sorted(run.glob(pattern)) for row in _rows(path)]
            for run in (whole, resumed)
        )
        assert len(one) == len(other) > 0
        for a, b in zip(one, other, strict=True):
            np.testing.assert_equal(a, b)


def _rows(path: Path) -> list[dict]:
    return pq.read_table(path).to_pylist()
