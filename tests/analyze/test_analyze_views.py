"""The SQL views of SPEC §6 and what they are made of."""

import shutil
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas import tables
from schemas.errors import ArtifactError
from schemas.progress import Silent
from stages.analyze.catalogue import artifacts, select
from stages.analyze.query import query
from stages.analyze.study import ask_all, choose
from stages.analyze.views import VIEWS, connect
from tests.analyze.fake_artifacts import write_dataset, write_estimator, write_manifest
from tests.analyze.fake_runs import write_run


def ask(root: Path, sql: str) -> list[tuple]:
    with connect(root) as connection:
        return connection.execute(sql).fetchall()


def test_every_view_is_typed_and_empty_without_artifacts(tmp_path: Path) -> None:
    assert set(VIEWS) == {
        *("runs", "episodes", "transitions", "evaluations", "updates"),
        *("datasets", "frames", "estimators", "epochs", "predictions"),
        *("relabels", "relabelled_episodes", "relabelled_transitions"),
    }
    with connect(tmp_path / "nowhere") as connection:
        for view in VIEWS:
            assert connection.execute(f"SELECT count(*) FROM {view}").fetchall() == [(0,)]
        types = dict(connection.execute("SELECT column_name, column_type FROM (DESCRIBE transitions)").fetchall())
    assert types["action"] == "FLOAT[]"
    assert types["run"] == "VARCHAR"
    assert types["global_step"] == "BIGINT"


def test_views_have_the_same_columns_and_types_empty_or_not(tmp_path: Path) -> None:
    write_run(tmp_path / "full", estimator=write_estimator(tmp_path / "full", dataset=write_dataset(tmp_path / "full")))
    for view in VIEWS:
        described = [
            ask(root, f"SELECT column_name, column_type FROM (DESCRIBE {view})")
            for root in (tmp_path / "full", tmp_path / "empty")
        ]
        assert described[0] == described[1]


def test_reach_and_lift_actions_union_although_their_lengths_differ(tmp_path: Path) -> None:
    write_run(tmp_path, task="reach", logged_steps=200)
    write_run(tmp_path, task="lift", logged_steps=400)
    rows = ask(tmp_path, "SELECT task, len(action), count(*) FROM transitions GROUP BY ALL ORDER BY task")
    assert rows == [("lift", 8, 400), ("reach", 7, 200)]


def test_runs_come_from_manifests(tmp_path: Path) -> None:
    estimator = write_estimator(tmp_path, "eye")
    write_run(tmp_path, "a", "reach", "dense", "pan", 5.0, 3, estimator=estimator)
    (row,) = ask(
        tmp_path,
        "SELECT run, name, cell, scheme, misalignment_deg, seed, status, estimator, global_steps, best_eval_return,"
        " config->>'$.policy.switch_episode', strftime(created_at, '%Y-%m-%d %H:%M') FROM runs",
    )
    assert row[:3] == ("a/reach-dense-pan05-seed3", "a", "reach-dense-pan05-seed3")
    assert row[3:8] == ("dense", 5.0, 3, "complete", "eye")
    assert row[8:] == (60_000, None, "100", "2026-01-02 03:04")


def test_running_and_failed_runs_are_there_with_what_they_have(tmp_path: Path) -> None:
    write_run(tmp_path, seed=0, status="failed", final=False)
    young = tmp_path / "runs" / "study" / "reach-dense-orbit00-seed1"
    young.mkdir()
    write_manifest(young, "runs/study/reach-dense-orbit00-seed1", {"run": {"seed": "no number"}}, {}, status="running")
    rows = ask(tmp_path, "SELECT status, seed, final_return IS NULL FROM runs ORDER BY status")
    assert rows == [("failed", 0, False), ("running", None, True)]


def test_logs_are_those_of_complete_and_running_runs(tmp_path: Path) -> None:
    for seed, status in enumerate(("complete", "running", "failed")):
        write_run(tmp_path, seed=seed, status=status)
    assert ask(tmp_path, "SELECT seed, status FROM runs ORDER BY seed") == [
        *((0, "complete"), (1, "running"), (2, "failed"))
    ]
    for view in ("transitions", "episodes", "evaluations"):
        assert ask(tmp_path, f"SELECT DISTINCT seed FROM {view} ORDER BY seed") == [(0,), (1,)]
    for manifest in (tmp_path / "runs").glob("*/*/manifest.json"):
        manifest.write_text(manifest.read_text().replace('"running"', '"failed"').replace('"complete"', '"failed"'))
    assert ask(tmp_path, "SELECT count(*) FROM transitions") == [(0,)]


def test_failed_estimators_are_listed_without_their_files(tmp_path: Path) -> None:
    estimator = write_estimator(tmp_path, "eye")
    write_manifest(estimator, "estimators/eye", {}, {}, status="failed")
    assert ask(tmp_path, "SELECT estimator, status FROM estimators") == [("eye", "failed")]
    assert ask(tmp_path, "SELECT count(*) FROM epochs") == [(0,)]


@pytest.mark.parametrize("text", ["", '{"id": "runs/study/', '{"name": "of another program"}'])
def test_an_unreadable_manifest_is_an_error_that_names_it(tmp_path: Path, text: str) -> None:
    write_run(tmp_path, seed=0)
    (write_run(tmp_path, seed=1) / "manifest.json").write_text(text)
    with pytest.raises(ArtifactError, match=r"reach-dense2sparse-orbit00-seed1/manifest\.json"):
        connect(tmp_path)


def test_datasets_and_estimators_come_from_manifests(tmp_path: Path) -> None:
    write_estimator(tmp_path, "eye", epochs=7, dataset=write_dataset(tmp_path, "frames"))
    assert ask(tmp_path, "SELECT dataset, frames, bytes FROM datasets") == [("frames", 2, 12345)]
    assert ask(tmp_path, "SELECT estimator, dataset, epochs, test_mean_error FROM estimators") == [
        ("eye", "frames", 7, 0.0152)
    ]
    assert ask(tmp_path, "SELECT split, count(*) FROM epochs GROUP BY ALL ORDER BY ALL") == [
        ("train", 7),
        ("validation", 7),
    ]


def test_foreign_hidden_and_temporary_directories_are_passed_over(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    for copy in (".hidden", "half.tmp", "renamed"):
        shutil.copytree(run.parent, tmp_path / "runs" / copy)
    (tmp_path / "runs" / "foreign" / "cell").mkdir(parents=True)
    (tmp_path / "runs" / "a-file").write_text("")
    (run / "transitions" / ".part-00009.parquet.tmp").write_text("half")
    (run / "transitions" / ".part-00010.parquet").write_text("half")
    assert ask(tmp_path, "SELECT run FROM runs") == [("study/reach-dense2sparse-orbit00-seed0",)]
    assert ask(tmp_path, "SELECT count(*) FROM transitions") == [(400,)]


def test_a_link_out_of_the_data_root_is_no_artifact(tmp_path: Path) -> None:
    write_run(tmp_path / "elsewhere")
    (tmp_path / "data" / "runs").mkdir(parents=True)
    (tmp_path / "data" / "runs" / "study").symlink_to(tmp_path / "elsewhere" / "runs" / "study")
    assert ask(tmp_path / "data", "SELECT count(*) FROM runs") == [(0,)]


@pytest.mark.parametrize("name", ["with 'quote", "with [glob]*?"])
def test_odd_data_roots(tmp_path: Path, name: str) -> None:
    write_run(tmp_path / name)
    assert ask(tmp_path / name, "SELECT count(*) FROM transitions") == [(400,)]


def test_missing_and_truncated_files_of_a_complete_run_are_errors(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    part = run / "transitions" / "part-00001.parquet"
    part.write_bytes(part.read_bytes()[:-10])
    with pytest.raises(ArtifactError, match="part-00001.parquet has .* bytes instead of"):
        connect(tmp_path)
    part.unlink()
    with pytest.raises(ArtifactError, match="part-00001.parquet is missing"):
        connect(tmp_path)


def test_a_foreign_file_in_a_running_run_is_an_error_that_names_the_view(tmp_path: Path) -> None:
    run = write_run(tmp_path, status="running")
    (run / "evaluations.parquet").write_bytes(b"no parquet at all")
    with pytest.raises(ArtifactError, match=r"view 'evaluations'.*evaluations\.parquet"):
        connect(tmp_path)


def test_another_schema_version_is_an_error(tmp_path: Path) -> None:
    directory = tmp_path / "datasets" / "new"
    directory.mkdir(parents=True)
    write_manifest(directory, "datasets/new", {}, {}, schema_version=tables.SCHEMA_VERSION + 1)
    with pytest.raises(ArtifactError, match=r"datasets/new/manifest\.json was made by a newer version of the pipeline"):
        connect(tmp_path)


def test_selection_by_name_cell_and_kind(tmp_path: Path) -> None:
    for seed in (0, 1):
        write_run(tmp_path, "a", seed=seed)
    write_run(tmp_path, "ab", seed=0)
    found = artifacts(tmp_path, "runs")
    assert [run.name for run in select(found, ["a"])] == [f"a/reach-dense2sparse-orbit00-seed{i}" for i in (0, 1)]
    assert [run.name for run in select(found, ["runs/ab/", "ab"])] == ["ab/reach-dense2sparse-orbit00-seed0"]
    with pytest.raises(ArtifactError, match="no readable artifact 'b' .* valid: a, a/reach-dense2sparse-orbit00-seed0"):
        select(found, ["b"])


def test_connection_reads_below_the_root_and_nowhere_else(tmp_path: Path) -> None:
    run = write_run(tmp_path / "data")
    outside = tmp_path / "outside.parquet"
    pq.write_table(pq.read_table(run / "evaluations.parquet"), outside)
    (tmp_path / "data" / "link.parquet").symlink_to(outside)
    with connect(tmp_path / "data") as connection:
        inside = f"SELECT count(*) FROM '{run}/evaluations.parquet'"
        assert connection.execute(inside).fetchall() == [(16,)]
        for path in (outside, f"{tmp_path}/data/../outside.parquet", f"{tmp_path}/data/link.parquet"):
            with pytest.raises(duckdb.PermissionException):
                connection.execute(f"SELECT * FROM '{path}'")
        for statement in (
            "SELECT * FROM read_csv('/etc/passwd')",
            "SELECT * FROM read_text('/proc/self/environ')",
            "SELECT * FROM glob('/etc/*')",
            "SELECT * FROM 'https://example.invalid/a.parquet'",
            "INSTALL httpfs",
            f"ATTACH '{tmp_path}/x.duckdb'",
            "SET enable_external_access = true",
            "RESET allowed_directories",
        ):
            with pytest.raises(duckdb.Error):
                connection.execute(statement)


def test_python_variables_are_not_tables(tmp_path: Path) -> None:
    secret = pq.read_table(write_run(tmp_path) / "evaluations.parquet")
    assert secret.num_rows
    with connect(tmp_path) as connection, pytest.raises(duckdb.CatalogException):
        connection.execute("SELECT * FROM secret")


def test_answers_of_an_analysis_are_the_same_bits_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of several threads are taken in whatever order they finish; so the analysis asks with one."""
    write_run(tmp_path)
    asked = []

    def watched(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.RecordBatchReader:
        asked.append(connection.execute("SELECT current_setting('threads')").fetchall())
        return query(connection, sql)

    monkeypatch.setattr("stages.analyze.study.query", watched)
    ask_all(tmp_path, choose(tmp_path, [], []), Silent())
    assert len(asked) > 5
    assert all(setting == [(1,)] for setting in asked)
