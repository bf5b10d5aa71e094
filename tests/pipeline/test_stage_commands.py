"""Each stage's command over a fake stage: what it asks of the stage, and what becomes an artifact."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.manifests import read_manifest
from pipeline.artifacts.store import Build, Store
from pipeline.config import load_config
from pipeline.matrix import cells
from pipeline.steps import policy
from pipeline.steps.session import Session
from schemas.errors import DivergedError
from schemas.progress import Silent
from stages.policy.config import MatrixConfig
from tests.pipeline.fakes import TINY, Run, Stages, answer, prepare, refused

DENSE, ORACLE = "runs/default/reach-dense-orbit00-seed0", "runs/default/reach-oracle-orbit00-seed0"


def test_collect(run: Run, stages: Stages, store: Store) -> None:
    made = answer(run("collect", *TINY, "--json"))
    assert (made["id"], made["did"], made["summary"]) == (
        "datasets/default",
        "made",
        {"episodes": 2, "frames": 2, "bytes": 4},
    )
    manifest = load_complete(store.root, "datasets/default")
    assert manifest.environment.gl_renderer == "test renderer"
    assert set(manifest.config) == {"world", "camera", "collect"}
    assert manifest.config["collect"]["episodes"] == 2
    assert stages.options["collect"]["dataset"] == "default"
    assert stages.options["collect"]["actor"] is None


def test_collecting_again_is_a_no_op_that_says_so(run: Run, stages: Stages) -> None:
    prepare(run, "collect")
    again = run("collect", *TINY)
    assert again.exit_code == 0
    assert "already complete, nothing to do" in again.stdout
    assert answer(run("collect", *TINY, "--json"))["did"] == "nothing"
    assert stages.calls == ["collect"]


@pytest.mark.parametrize(
    ("stage", "artifact"), [("collect", "datasets/default"), ("train-perception", "estimators/default")]
)
def test_what_diverged_has_failed_and_says_why(
    run: Run, stages: Stages, store: Store, stage: str, artifact: str
) -> None:
    """It is no interruption: to resume repeats it, unless something has changed."""
    prepare(run, *(["collect"] if stage == "train-perception" else []))
    stages.errors = {stage: DivergedError("the loss is nan; lower the rate")}
    refused(run(stage, *TINY), 4, "the loss is nan; lower the rate")
    manifest = read_manifest(store.path(artifact), artifact)
    assert (manifest.status, manifest.summary) == ("failed", {"error": "the loss is nan; lower the rate"})
    refused(run(stage, *TINY), 2, f"{artifact} failed earlier (the loss is nan; lower the rate): add --resume to try")
    assert answer(run(stage, *TINY, "--resume", "--json"))["did"] == "resumed"
    assert load_complete(store.root, artifact).status == "complete"


def test_quiet_says_nothing(run: Run, stages: Stages) -> None:
    assert run("collect", *TINY, "--quiet").output == ""


def test_collect_with_a_policy(run: Run, stages: Stages, store: Store) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    aimed = ("collect", *TINY, "--name", "aimed", "--policy", "reach-dense-orbit00-seed0")
    refused(run(*aimed), 2, """trained to reach: collect with it by --set collect.tasks="['reach']\"""")
    answer(run(*aimed, "--set", "collect.tasks=['reach']", "--json"))
    assert stages.options["collect"]["actor"].args == (store.path(DENSE),)
    assert [ref.id for ref in load_complete(store.root, "datasets/aimed").inputs] == [DENSE]
    refused(run("collect", "--name", "x", "--policy", "nobody"), 3, "no artifact 'nobody'")


def test_another_config_under_the_name_is_refused(run: Run, stages: Stages) -> None:
    prepare(run, "collect")
    refused(run("collect", "--set", "collect.episodes=3"), 2, "collect.episodes: 2 → 3")
    assert answer(run("collect", "--name", "other", "--set", "collect.episodes=3", "--json"))["id"] == "datasets/other"


def test_train_perception(run: Run, stages: Stages, store: Store, tmp_path: Path) -> None:
    prepare(run, "collect")
    weights = tmp_path / "imagenet.safetensors"
    weights.write_bytes(b"weights")
    made = answer(run("train-perception", "--name", "eye", "--dataset", "default", "--weights", weights, "--json"))
    assert (made["id"], made["summary"]["test_mean_error"]) == ("estimators/eye", 0.014)
    manifest = load_complete(store.root, "estimators/eye")
    assert [ref.id for ref in manifest.inputs] == ["datasets/default"]
    assert len(manifest.config["weights_sha256"]) == 64
    given = stages.options["train-perception"]
    assert (given["dataset"], given["weights"]) == (store.path("datasets/default"), weights)
    assert (given["estimator"], given["rerender"]) == ("eye", "rerender")


def test_train_perception_without_its_inputs(run: Run, stages: Stages, tmp_path: Path) -> None:
    refused(run("train-perception"), 3, "datasets/default does not exist")
    prepare(run, "collect")
    refused(run("train-perception", "--weights", tmp_path / "none"), 3, "no weights file")
    assert stages.calls == ["collect"]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: (path / "manifest.json").unlink(), "is no artifact of this pipeline"),
        (lambda path: (path / "manifest.json").write_text('{"id": "datas'), "is truncated or no JSON"),
        (lambda path: (path / "manifest.json").write_text('{"schema_version": 99}'), "made by a newer version"),
        (lambda path: (path / "manifest.json").write_text('{"name": "theirs"}'), "no manifest of this pipeline"),
        (lambda path: (path / "frames.parquet").write_bytes(b"fr"), "2 bytes instead of 6"),
        (lambda path: (path / "frames.parquet").write_bytes(b"FRAMES"), "is not what was written"),
        (lambda path: (path / "episodes" / "episode-000000.mcap").unlink(), "episode-000000.mcap is missing"),
    ],
)
def test_a_damaged_dataset_is_refused(run: Run, stages: Stages, data: Path, damage: Any, message: str) -> None:
    prepare(run, "collect")
    damage(data / "datasets" / "default")
    refused(run("train-perception"), 3, message)
    assert not (data / "estimators" / "default").exists()


def test_an_unfinished_dataset_is_refused(run: Run, stages: Stages) -> None:
    stages.errors = {"collect": KeyboardInterrupt()}
    run("collect", *TINY)
    refused(run("train-perception"), 3, "datasets/default is not finished: resume it with `pipeline collect")


def test_train_policy_makes_a_run_of_every_cell(run: Run, stages: Stages, store: Store) -> None:
    prepare(run, "collect", "train-perception")
    made = answer(run("train-policy", *TINY, "--json"))
    assert [cell["id"] for cell in made["cells"]] == [DENSE, ORACLE]
    dense, oracle = (load_complete(store.root, each) for each in (DENSE, ORACLE))
    assert [ref.id for ref in dense.inputs] == ["estimators/default"]
    assert oracle.inputs == dense.inputs, "the oracle logs what it would have been told"
    assert (dense.config["estimator"], oracle.config["estimator"]) == ("default", "default")
    assert dense.config["run"] == {
        "task": "reach",
        "scheme": "dense",
        "misalignment_kind": "orbit",
        "misalignment_deg": 0.0,
        "seed": 0,
    }
    assert set(dense.config) == {"world", "policy", "run", "estimator"}
    assert "workers" not in dense.config["policy"]
    assert dense.environment.gl_renderer == oracle.environment.gl_renderer == "test renderer"
    [call] = stages.calls_of("train-policy")
    assert [(f"runs/{spec.run_id}", spec.out) for spec in call["specs"]] == [
        (cell, store.path(cell)) for cell in (DENSE, ORACLE)
    ]
    assert call["estimator"] == store.path("estimators/default")
    assert call["resources"] == ("cpu", None, None, None)


def test_a_manifest_says_what_the_networks_ran_on(
    run: Run, stages: Stages, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run does not go on where it would round differently: its configuration does not say so."""
    for step in ("perception", "policy"):
        monkeypatch.setattr(f"pipeline.steps.{step}.require_device", lambda device: None)
    prepare(run, "collect")
    assert run("train-perception", *TINY, "--set", "perception.device=cuda").exit_code == 0
    assert load_complete(store.root, "estimators/default").environment.device == "cuda"
    gpu = ("--set", "policy.device=cuda")
    stages.errors = {"train-policy": KeyboardInterrupt()}
    assert run("train-policy", *TINY, *gpu).exit_code == 130
    assert read_manifest(store.path(DENSE), DENSE).environment.device == "cuda"
    refused(run("train-policy", *TINY, "--resume"), 2, f"{DENSE} was begun on cuda, and cpu rounds differently")
    assert run("train-policy", *TINY, *gpu, "--resume").exit_code == 0
    assert "networks on cuda" in " ".join(run("show", DENSE).stdout.split())


def test_an_oracle_needs_no_estimator(run: Run, stages: Stages) -> None:
    assert run("train-policy", "--set", "policy.schemes=['oracle']").exit_code == 0
    assert stages.options["train-policy"]["estimator"] is None
    refused(run("train-policy", "--name", "other"), 3, "estimators/other does not exist")


def test_only_the_missing_cells_are_trained(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    made = answer(run("train-policy", *TINY, "--set", "policy.schemes=['dense', 'sparse']", "--json"))
    assert [cell["did"] for cell in made["cells"]] == ["nothing", "made"]
    assert [spec.scheme for spec in stages.options["train-policy"]["specs"]] == ["sparse"]


def test_a_failed_cell_does_not_stop_the_others(run: Run, stages: Stages, store: Store) -> None:
    prepare(run, "collect", "train-perception")
    stages.failing_cells = {"dense": "NaN at step 7"}
    result = run("train-policy", *TINY)
    assert result.exit_code == 4
    assert f"1 of 2 runs failed: {DENSE} (NaN at step 7)" in result.stderr
    failed = read_manifest(store.path(DENSE), DENSE)
    assert (failed.status, failed.summary) == ("failed", {"episodes": 1, "error": "NaN at step 7"})
    assert [file.path for file in failed.files] == ["episodes.parquet"]
    assert load_complete(store.root, ORACLE).status == "complete"
    refused(run("train-policy", *TINY), 2, "failed earlier (NaN at step 7): add --resume")
    stages.failing_cells = {}
    assert [cell["did"] for cell in answer(run("train-policy", *TINY, "--resume", "--json"))["cells"]] == [
        "resumed",
        "nothing",
    ]


def test_analyze_everything_that_is_finished(run: Run, stages: Stages, store: Store) -> None:
    refused(run("analyze"), 3, "nothing to analyze")
    prepare(run, "collect", "train-perception")
    stages.failing_cells = {"dense": "NaN"}
    assert run("train-policy", *TINY).exit_code == 4
    answer(run("analyze", "--json"))
    assert stages.options["analyze"]["runs"] == [DENSE.removeprefix("runs/"), ORACLE.removeprefix("runs/")]
    assert stages.options["analyze"]["estimators"] == ["default"]
    assert [ref.id for ref in load_complete(store.root, "reports/default").inputs] == [
        DENSE,
        ORACLE,
        "estimators/default",
    ]


def test_analyze_what_is_named(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    made = answer(run("analyze", "--name", "one", "--runs", ORACLE.removeprefix("runs/"), "--json"))
    assert (made["id"], stages.options["analyze"]["estimators"]) == ("reports/one", ["default"])
    assert stages.options["analyze"]["runs"] == [ORACLE.removeprefix("runs/")]
    refused(run("analyze", "--runs", "nobody"), 3, "no run 'nobody'")


def test_a_report_on_runs_pins_their_estimators(run: Run, stages: Stages, store: Store, data: Path) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    asked = ("analyze", "--runs", "default", "--json")
    answer(run(*asked))
    pinned = [ref.id for ref in load_complete(store.root, "reports/default").inputs]
    assert pinned == [DENSE, ORACLE, "estimators/default"]
    (data / "estimators" / "default").rename(data / "elsewhere")
    answer(run(*asked))
    assert [ref.id for ref in load_complete(store.root, "reports/default").inputs] == [DENSE, ORACLE]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: (path / "estimator.safetensors").write_bytes(b"w"), "1 bytes instead of 7"),
        (lambda path: (path / "estimator.safetensors").write_bytes(b"WEIGHTS"), "is not what was written"),
        (lambda path: (path / "manifest.json").write_text('{"name": "theirs"}'), "no manifest of this pipeline"),
        (lambda path: (path / "manifest.json").write_text('{"schema_version": 99}'), "made by a newer version"),
    ],
)
def test_a_damaged_estimator_is_refused(run: Run, stages: Stages, data: Path, damage: Any, message: str) -> None:
    prepare(run, "collect", "train-perception")
    damage(data / "estimators" / "default")
    refused(run("train-policy"), 3, message)
    assert "train-policy" not in stages.calls
    assert not list((data / "runs").rglob("manifest.json"))


def test_an_estimator_of_another_robot_is_refused(run: Run, stages: Stages, data: Path) -> None:
    prepare(run, "collect", "train-perception")
    sawyer = ("train-policy", *TINY, "--set", "world.robot=Sawyer")
    refused(run(*sawyer), 2, "estimators/default learned from images of Panda (datasets/default), but world.robot is")
    refused(run(*sawyer, "--dry-run"), 2, "use --set world.robot=Panda, or an estimator of Sawyer")
    (data / "datasets" / "default").rename(data / "elsewhere")
    assert run(*sawyer).exit_code == 0, "what the estimator saw is not known any more"


def test_episodes_of_a_run_count_every_evaluation() -> None:
    [cell] = cells(MatrixConfig(schemes=("dense",), episodes=50, eval_every=20, eval_episodes=5, final_episodes=7))
    session = cast(Session, SimpleNamespace(config=load_config(overrides=["world.horizon=10"])))
    work = policy.Work(policy.Matrix(session, "x"), cell, cast(Build, None))
    assert policy.space_needed([work, work]) == 2 * policy.BYTES_PER_STEP * 10 * (50 + 2 * 5 + 7)


def test_runs_older_than_the_sizes_of_observations_saw_metres(run: Run, stages: Stages, store: Store) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    made = load_complete(store.root, DENSE).config
    del made["policy"]["observation_scale"]
    session = Session(store, load_config(overrides=TINY[1::2]), Silent(), resume=False)
    asked = {request.id: request for _, request in policy.requests(policy.Matrix(session, "default"), None)}
    changed = [line for line in asked[DENSE].differences(made) if "observation_scale" in line]
    assert changed == [
        "policy.observation_scale.cube: 1.0 → 0.15",
        "policy.observation_scale.cube_to_eef: 1.0 → 0.05",
        "policy.observation_scale.eef: 1.0 → 0.2",
        "policy.observation_scale.gripper_opening: 1.0 → 0.03",
    ]


def test_a_report_follows_its_inputs(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception", "train-policy", "analyze")
    assert answer(run("analyze", "--json"))["did"] == "nothing"
    assert run("train-policy", *TINY, "--set", "policy.seeds=[1]").exit_code == 0
    assert answer(run("analyze", "--json"))["did"] == "made"
    assert len(stages.options["analyze"]["runs"]) == 4
