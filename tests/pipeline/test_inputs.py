"""Artifacts that are to be read: found, verified, followed back; and what manifests record."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.artifacts import environment
from pipeline.artifacts.inputs import lineage, load_complete, resolve
from pipeline.artifacts.store import Request, Store
from schemas.errors import ArtifactError, ConfigError
from schemas.tables import SCHEMA_VERSION
from tests.pipeline.fakes import begin


def test_a_missing_input_lists_what_there_is(store: Store, dataset: Path) -> None:
    with pytest.raises(ArtifactError, match=r"datasets/big does not exist .*there: datasets/small"):
        load_complete(store.root, "datasets/big")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "truncated or no JSON"),
        ('{"id": "datasets/small", "sta', "truncated or no JSON"),
        ("[]", "no schema_version"),
        ('{"name": "something else"}', "no schema_version"),
        ('{"schema_version": 1, "id": 3}', "is no manifest of this pipeline: id"),
        (json.dumps({"schema_version": SCHEMA_VERSION + 1}), "made by a newer version"),
    ],
)
def test_unreadable_manifests(store: Store, dataset: Path, text: str, message: str) -> None:
    (dataset / "manifest.json").write_text(text)
    with pytest.raises(ArtifactError, match=message):
        load_complete(store.root, "datasets/small")


def test_a_directory_without_manifest_is_foreign(store: Store) -> None:
    (store.root / "datasets" / "mine").mkdir(parents=True)
    with pytest.raises(ArtifactError, match="no artifact of this pipeline"):
        load_complete(store.root, "datasets/mine")
    with pytest.raises(ArtifactError, match="no artifact of this pipeline"):
        store.begin(Request("datasets/mine", {}), resume=True)


def test_a_renamed_artifact_is_foreign(store: Store, dataset: Path) -> None:
    dataset.rename(dataset.with_name("renamed"))
    with pytest.raises(ArtifactError, match="belongs to 'datasets/small'"):
        load_complete(store.root, "datasets/renamed")


@pytest.mark.parametrize(("status", "message"), [("running", "is not finished: resume"), ("failed", "failed: resume")])
def test_unfinished_inputs(store: Store, dataset: Path, edit: Callable[..., None], status: str, message: str) -> None:
    edit(dataset, status=status)
    with pytest.raises(ArtifactError, match=message):
        load_complete(store.root, "datasets/small")


def test_damage_by_size_and_by_content(store: Store, dataset: Path) -> None:
    (dataset / "frames.parquet").write_bytes(b"PARQUET")  # as long as before
    with pytest.raises(ArtifactError, match=r"damaged: frames.parquet is not what was written"):
        load_complete(store.root, "datasets/small")
    (dataset / "frames.parquet").write_bytes(b"parq")
    with pytest.raises(ArtifactError, match="4 bytes instead of 7"):
        load_complete(store.root, "datasets/small")


def finish(store: Store, artifact_id: str, *inputs: str) -> None:
    from pipeline.artifacts.inputs import input_ref

    with begin(store, Request(artifact_id, {}, [input_ref(store.root, each) for each in inputs])) as build:
        build.finish({})


@pytest.fixture
def family(store: Store, dataset: Path) -> Store:
    """dataset → estimator → two runs."""
    finish(store, "estimators/eye", "datasets/small")
    for cell in ("one", "two"):
        finish(store, f"runs/small/{cell}", "estimators/eye")
    return store


@pytest.mark.parametrize(
    ("reference", "meant"),
    [
        ("datasets/small", "datasets/small"),
        ("eye", "estimators/eye"),
        ("small/one", "runs/small/one"),
        ("runs/small/two", "runs/small/two"),
        ("runs/small/two/", "runs/small/two"),
        ("two", "runs/small/two"),
    ],
)
def test_references(family: Store, reference: str, meant: str) -> None:
    assert resolve(family.root, reference) == meant
    assert resolve(family.root, f"{family.root}/{meant}") == meant


def test_ambiguous_and_unknown_references(family: Store) -> None:
    with pytest.raises(ConfigError, match="ambiguous, it may mean: datasets/small, runs/small/one, runs/small/two"):
        resolve(family.root, "small")
    with pytest.raises(ConfigError, match="ambiguous, it may mean: runs/small/one, runs/small/two"):
        resolve(family.root, "runs/small")
    with pytest.raises(ArtifactError, match="no artifact 'nobody' .*there: datasets/small, estimators/eye"):
        resolve(family.root, "nobody")


def test_lineage_goes_back_to_the_first_input(family: Store) -> None:
    run = lineage(family.root, "runs/small/one")
    assert [run.id, run.inputs[0].id, run.inputs[0].inputs[0].id] == [
        "runs/small/one",
        "estimators/eye",
        "datasets/small",
    ]
    assert not run.inputs[0].inputs[0].changed


def test_lineage_tells_what_changed_and_what_is_gone(family: Store, edit: Callable[..., None]) -> None:
    edit(family.path("datasets/small"), summary={})
    assert lineage(family.root, "estimators/eye").inputs[0].changed
    family.path("estimators/eye").rename(family.root / "elsewhere")
    gone = lineage(family.root, "runs/small/one").inputs[0]
    assert (gone.id, gone.manifest) == ("estimators/eye", None)


def test_code_knows_its_commit() -> None:
    code = environment.code()
    assert code.version == "0.1.0"
    assert code.git_commit is None or len(code.git_commit) == 40


def test_gpu_is_read_from_the_driver(tmp_path: Path) -> None:
    assert environment.gpu_model(tmp_path) is None
    (tmp_path / "0000:01:00.0").mkdir()
    (tmp_path / "0000:01:00.0" / "information").write_text("Model: \t\t NVIDIA H200\nIRQ: 3\n")
    assert environment.gpu_model(tmp_path) == "NVIDIA H200"
