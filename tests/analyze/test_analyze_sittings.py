"""Answers of several sittings: what a newer one replaces, also where it says nothing, and what it leaves."""

import json
from typing import Any

import pytest

from schemas.manifest import Code, Environment, InputRef
from stages.analyze.config import AnalyzeConfig
from stages.analyze.records import Provenance, Record, together
from stages.analyze.results import IDENTITY, Answer, Row
from stages.analyze.sittings import together as answers_together
from stages.analyze.sittings import told_apart, without
from stages.analyze.studies import Study

MACHINE = Environment(python="3.11", platform="Linux", cpu="2 cores", gpu=None, gl_renderer=None, packages={})


def setting(scheme: str, name: str = "laptop") -> Row:
    return dict(zip(IDENTITY, (name, "reach", "orbit", 10.0, scheme), strict=True))


def run(scheme: str, name: str = "laptop", estimator: str | None = "resnet", **more: Any) -> Row:
    identity, config = setting(scheme, name), json.dumps({"estimator": estimator, "policy": {"episodes": 300}})
    row = {"run": f"{name}/reach-{scheme}", **identity, "seed": 0, "status": "complete", "main": name == "laptop"}
    return {**row, "estimator": estimator, "config": config, **more}


def answers(**rows: list[Row]) -> dict[str, Answer]:
    return {name.replace("_", "-"): Answer("SELECT", each) for name, each in rows.items()}


def test_a_rerun_that_says_nothing_leaves_nothing_of_what_it_said_before() -> None:
    """It failed: an evaluation or a curve of the run before would stand beside a failed one."""
    runs = [run("dense"), run("sparse")]
    old = answers(
        runs=runs,
        outcomes=[{"run": each["run"], "mean_return": 150.0} for each in runs],
        learning_curves=[setting("dense"), setting("sparse")],
    )
    kept = without(old, [run("dense", status="failed")])
    assert [row["run"] for row in kept["outcomes"].rows] == ["laptop/reach-sparse"]
    assert [row["scheme"] for row in kept["learning-curves"].rows] == ["sparse"]


@pytest.mark.parametrize(
    ("rerun", "switches", "effects"),
    [("dense2sparse", 0, []), ("dense", 1, ["dense2sparse"]), ("sparse", 1, ["dense2sparse", "dense"])],
)
def test_the_switch_is_one_of_dense2sparse_with_dense_beside_it(rerun: str, switches: int, effects: list[str]) -> None:
    schemes = ("dense2sparse", "dense")
    place = {key: value for key, value in setting("").items() if key != "scheme"}
    effect = [setting(scheme) for scheme in schemes]
    old = answers(runs=[run(scheme) for scheme in schemes], switches=[place], switch_effect=effect)
    kept = without(old, [run(rerun)])
    assert len(kept["switches"].rows) == switches
    assert [row["scheme"] for row in kept["switch-effect"].rows] == effects


def test_nothing_is_lost_against_an_oracle_that_is_another_one_now() -> None:
    lost = {"estimation_error": 0.02, "compared": 8, "lost_return": 40.0}
    old = answers(runs=[], regions=[setting("dense") | lost], region_correlation=[setting("dense") | lost])
    assert without(old, [run("oracle")])["regions"].rows == [
        setting("dense") | {"estimation_error": 0.02, "compared": 0, "lost_return": None}
    ]
    assert without(old, [run("oracle")])["region-correlation"].rows == []
    assert without(old, [run("sparse")]) == old


def test_estimators_go_with_the_last_run_that_had_them() -> None:
    known = [{"estimator": name, "test_mean_error": 0.01} for name in ("resnet", "shared", "alone")]
    runs = [run("dense"), run("sparse", estimator="shared"), run("oracle", estimator="shared")]
    old = answers(runs=runs, estimators=known)
    kept = without(old, [run("dense"), run("sparse")])
    assert [row["estimator"] for row in kept["estimators"].rows] == ["shared", "alone"]
    new = answers(runs=[run("dense")], estimators=[{"estimator": "resnet", "test_mean_error": 0.02}])
    assert told_apart(kept, new) == new, "its name is free again"
    assert told_apart(old, new)["runs"].rows[0]["estimator"] == "resnet (2)"


def test_an_estimator_is_the_third_where_it_is_neither_of_two() -> None:
    old = answers(estimators=[{"estimator": name, "e": e} for name, e in (("resnet", 1), ("resnet (2)", 2))])
    for error, label in ((1, "resnet"), (2, "resnet (2)"), (3, "resnet (3)")):
        new = answers(estimators=[{"estimator": "resnet", "e": error}], runs=[run("dense")])
        assert {row["estimator"] for each in told_apart(old, new).values() for row in each.rows} == {label}
    old = answers(estimators=[{"estimator": "resnet (3)", "e": 3}])  # the others went with their last runs
    for error, label in ((3, "resnet (3)"), (1, "resnet")):
        new = answers(estimators=[{"estimator": "resnet", "e": error}])
        assert told_apart(old, new)["estimators"].rows[0]["estimator"] == label


def test_a_study_beside_main_runs_with_another_estimator_says_so() -> None:
    """The variant was trained in the first sitting, the main runs of the same setting in the second."""
    variant = run("dense2sparse", "laptop-touch-none")
    study = Study("touch", "?", ("world.touch",), ("laptop-touch-none",), "laptop")
    error = [{"estimator": "resnet", "test_mean_error": 0.01}]
    old = answers(runs=[variant], estimators=error, study_outcomes=[{"study": "touch", **variant}], outcomes=[])
    new = answers(runs=[run("dense2sparse")], estimators=[error[0] | {"test_mean_error": 0.02}], outcomes=[])
    rows = answers_together(old, told_apart(old, new), [study])["study-outcomes"].rows
    assert {row["name"]: json.loads(row["config"])["estimator"] for row in rows} == {
        "laptop-touch-none": "resnet",
        "laptop": "resnet (2)",
    }


def test_a_column_that_one_sitting_lacks_is_empty_there() -> None:
    old, new = answers(runs=[run("dense")]), answers(runs=[run("sparse", robot="Panda")])
    rows = answers_together(old, new, [])["runs"].rows
    assert [(row["scheme"], row["robot"]) for row in rows] == [("dense", None), ("sparse", "Panda")]


def record(id: str, sha: str, *inputs: Record) -> Record:
    pins = [InputRef(id=each.id, manifest_sha256=each.manifest_sha256) for each in inputs]
    code = Code(version="1", git_commit=None, dirty=None)
    fields = {"status": "complete", "created_at": "", "config_sha256": "", "environment": 0, "error": None}
    return Record(id=id, manifest_sha256=sha, code=code, inputs=pins, **fields)


def told(*artifacts: Record, left_out: dict[str, int] | None = None) -> Provenance:
    fields = {"analysis": AnalyzeConfig(), "studies": [], "environments": [MACHINE], "figures": []}
    return Provenance(artifacts=list(artifacts), left_out=left_out or {}, **fields)


def test_provenance_forgets_what_only_replaced_runs_descend_from() -> None:
    dataset, other = record("datasets/a", "d"), record("datasets/b", "b")
    first, second = record("estimators/a", "e1", dataset), record("estimators/b", "e2", other)
    earlier = told(dataset, other, first, second, record("runs/x/1", "r1", first), record("runs/x/2", "r2", second))
    again = record("estimators/a", "e3", dataset)
    both = together(earlier, told(dataset, again, record("runs/x/1", "r3", again)))
    found = {(each.id, each.manifest_sha256) for each in both.artifacts}
    kept = {("datasets/a", "d"), ("datasets/b", "b"), ("estimators/b", "e2"), ("runs/x/2", "r2")}
    assert found == kept | {("estimators/a", "e3"), ("runs/x/1", "r3")}
    assert both.accumulated


def test_a_run_that_a_replaced_one_learnt_from_is_kept() -> None:
    estimator = record("estimators/a", "e")
    source = record("runs/x/1", "r1", estimator)
    offline = record("runs/off/1", "r2", source, estimator)
    both = together(told(estimator, source, offline), told(record("runs/off/1", "r3")))
    assert {each.id for each in both.artifacts} == {"estimators/a", "runs/x/1", "runs/off/1"}


def test_what_an_earlier_sitting_left_out_is_not_forgotten() -> None:
    earlier = told(record("runs/x/1", "a"), left_out={"x": 3, "y": 2})
    assert together(earlier, told(record("runs/x/2", "b"), left_out={"z": 1})).left_out == {"y": 2, "z": 1}
