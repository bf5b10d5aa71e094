"""SQL as a user asks it: what is refused, what is streamed, and how it is written."""

import csv
import io
import json
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.errors import ArtifactError, ConfigError
from stages.analyze.query import query, run_sql, write
from stages.analyze.views import connect
from tests.analyze.fake_runs import write_run


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_run(tmp_path / "data", seed=0, episodes=40)
    write_run(tmp_path / "data", seed=1, episodes=60, final=False)
    return tmp_path / "data"


def answer(root: Path, sql: str, format: str = "json") -> str:
    stream = io.StringIO()
    run_sql(root, sql, format, None, stream)
    return stream.getvalue()


def test_answers_by_hand(root: Path) -> None:
    sql = "SELECT seed, count(*) AS n FROM evaluations WHERE split = 'eval' GROUP BY ALL ORDER BY seed"
    assert json.loads(answer(root, sql)) == [{"seed": 0, "n": 2}, {"seed": 1, "n": 3}]


@pytest.mark.parametrize(
    "sql",
    [
        "select 1",
        "WITH a AS (SELECT 1 AS x) SELECT * FROM a;",
        "-- a comment\nFROM range(3)",
        "VALUES (1)",
        "DESCRIBE runs",
        "DESCRIBE SELECT 1",
        "SUMMARIZE evaluations",
        "SHOW TABLES",
        "EXPLAIN SELECT * FROM runs",
        "EXPLAIN ANALYZE SELECT * FROM runs",
        "SELECT (SELECT max(seed) FROM runs), * FROM (SELECT 1 UNION ALL SELECT 2)",
        "WITH RECURSIVE t(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM t WHERE i < 5) FROM t",
        "FROM evaluations PIVOT (avg(mean_return) FOR seed IN (0, 1))",
    ],
)
def test_reading_statements_are_answered(root: Path, sql: str) -> None:
    assert json.loads(answer(root, sql))


@pytest.mark.parametrize(
    "sql",
    [
        "COPY (SELECT 1) TO '{root}/x.csv'",
        "EXPLAIN ANALYZE COPY (SELECT 1) TO '{root}/x.csv'",
        "explain analyze (format json) copy (select 1) to '{root}/x.csv'",
        "EXPLAIN /* */ ANALYZE COPY (SELECT 1) TO '{root}/x.csv'",
        "WITH a AS (COPY (SELECT 1) TO '{root}/x.csv') SELECT * FROM a",
        "EXPLAIN ANALYZE WITH a AS (COPY (SELECT 1) TO '{root}/x.csv') SELECT * FROM a",
        "WITH a AS (INSERT INTO runs (run) VALUES ('x') RETURNING *) SELECT * FROM a",
        "SELECT * FROM json_execute_serialized_sql('{{}}')",
        "SELECT * FROM query('COPY (SELECT 1) TO ''{root}/x.csv''')",
        "CREATE TABLE x (i INT)",
        "CREATE TABLE x AS SELECT 1",
        "DROP VIEW episodes",
        "INSERT INTO runs (run) VALUES ('x')",
        "DELETE FROM runs",
        "ATTACH '{root}/x.duckdb' AS x",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET threads = 1",
        "PRAGMA database_list",
        "CALL enable_logging()",
        "EXPORT DATABASE '{root}/x'",
        "SELECT 1; SELECT 2",
        "SELECT 1; COPY (SELECT 1) TO '{root}/x.csv'",
        "",
        "-- nothing",
    ],
)
def test_all_else_is_refused_and_writes_nothing(root: Path, sql: str) -> None:
    before = sorted(root.rglob("*"))
    with pytest.raises(ConfigError, match=r"^SQL: "):
        answer(root, sql.format(root=root))
    assert sorted(root.rglob("*")) == before


def test_reads_outside_the_data_root_are_refused(root: Path) -> None:
    for source in ("read_csv('/etc/passwd')", f"'{root}/../secret.csv'", "read_json('/etc/passwd')"):
        with pytest.raises(ConfigError, match="Permission Error"):
            answer(root, f"SELECT * FROM {source}")


def test_table_functions_that_may_do_more_than_read_are_refused_with_the_valid_ones(root: Path) -> None:
    with pytest.raises(ConfigError, match=r"unknown table function 'read_duckdb'; valid: .*read_parquet"):
        answer(root, "FROM read_duckdb('x')")


@pytest.mark.parametrize(
    ("sql", "message", "mark"),
    [
        ("SELEC 1", "syntax error", "^^^^^"),
        ("SELECT\n  sead\nFROM runs", 'column "sead" not found', "LINE 2"),
        ("-- of\n\n-- runs\nSELECT\n  sead\nFROM runs", '"sead" not found', "LINE 5:   sead\n          ^^^^"),
        (
            9 * "--\n" + "SELECT sead FROM runs",
            '"sead" not found',
            "LINE 10: SELECT sead FROM runs\n                ^^^^",
        ),
        ("/* a\nb */ SELECT sead FROM runs", 'column "sead" not found', "LINE 2: SELECT sead"),
        ("SELECT * FROM rums", "rums does not exist", "LINE 1: SELECT * FROM rums\n                      ^"),
        ("SELECT cast(run AS INT) FROM runs", "Could not convert string", "^^^"),
    ],
)
def test_errors_point_at_the_spot(root: Path, sql: str, message: str, mark: str) -> None:
    with pytest.raises(ConfigError) as error:
        answer(root, sql)
    assert message in str(error.value)
    assert mark in str(error.value)


def test_a_plan_is_shown_whole(root: Path) -> None:
    shown = answer(root, "EXPLAIN SELECT scheme, avg(seed) FROM runs GROUP BY scheme", "table")
    assert "explain_value:" in shown and "╰──" in shown and "…" not in shown


def test_damage_found_while_reading_is_an_artifact_error(root: Path) -> None:
    run = write_run(root, seed=2, status="running")
    part = run / "transitions" / "part-00001.parquet"
    part.write_bytes(b"PAR1 and then nothing")
    with pytest.raises(ArtifactError, match="part-00001"):
        answer(root, "SELECT sum(step) FROM transitions")


def test_csv_writes_lists_as_json_and_nulls_as_nothing(root: Path) -> None:
    sql = """SELECT 1 AS a, NULL AS b, [1.5, 2]::FLOAT[] AS c, 'x, "y"' AS d, true AS e, ['k', NULL] AS f,
             0.1::FLOAT AS g"""
    assert list(csv.reader(io.StringIO(answer(root, sql, "csv")))) == [
        ["a", "b", "c", "d", "e", "f", "g"],
        ["1", "", "[1.5, 2]", 'x, "y"', "true", '["k", null]', "0.1"],
    ]


def test_csv_lists_of_floats_may_be_null_empty_or_not_finite(root: Path) -> None:
    sql = """SELECT unnest([[0.5], NULL, [], [NULL, 'nan'::FLOAT, 'inf'::FLOAT, -1e-9]]::FLOAT[][]) AS x, 1 AS y"""
    lines = [line for line, _ in csv.reader(io.StringIO(answer(root, sql, "csv")))]
    assert lines == ["x", "[0.5]", "", "[]", "[null, null, null, -1e-9]"]


def test_csv_of_dates_times_and_large_integers(root: Path) -> None:
    sql = "SELECT DATE '2026-01-02' AS a, TIMESTAMP '2026-01-02 03:04:05' AS b, sum(1::HUGEINT) AS c, {'k': 1} AS d"
    assert answer(root, sql, "csv").splitlines()[1] == '2026-01-02,2026-01-02T03:04:05,1,"{""k"": 1}"'


def test_json_has_only_what_json_knows(root: Path) -> None:
    sql = (
        "SELECT 'nan'::FLOAT AS a, [1, 'inf'::DOUBLE] AS b, DATE '2026-01-02' AS c, 12::HUGEINT AS d, {'k': 1} AS e,"
        " 1.5::DECIMAL(4, 2) AS f, true AS g, '\\xAB'::BLOB AS h, sum(1) AS i"
    )
    assert json.loads(answer(root, sql)) == [
        {"a": None, "b": [1.0, None], "c": "2026-01-02", "d": 12, "e": {"k": 1}, "f": 1.5, "g": True, "h": "ab", "i": 1}
    ]
    assert json.loads(answer(root, "SELECT 1 WHERE false")) == []


def test_table_is_aligned_and_says_what_it_leaves_out(root: Path) -> None:
    lines = answer(
        root, "SELECT i AS number, 'a' AS word, NULL::INT AS empty FROM range(250) t(i)", "table"
    ).splitlines()
    assert lines[0] == "number  word  empty"
    assert lines[2] == "     0  a         ·"
    assert len(lines) == 2 + 100 + 1
    assert lines[-1].startswith("… 150 more rows of 250")
    assert answer(root, "SELECT 1 AS a WHERE false", "table").splitlines() == ["a", "─"]


def test_parquet_goes_to_a_file_only(root: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="-o FILE"):
        answer(root, "SELECT 1", "parquet")
    target = tmp_path / "out.parquet"
    assert run_sql(root, "SELECT run, action FROM transitions", "parquet", target, io.StringIO()) == 800
    assert pq.read_table(target).schema.field("action").type == pa.list_(pa.float32())


def test_a_file_is_whole_or_absent(root: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.csv"
    sql = "SELECT CASE WHEN i > 90000 THEN error('too late') ELSE i END FROM range(100000) t(i)"
    with pytest.raises(ConfigError, match="too late"):
        run_sql(root, sql, "csv", target, io.StringIO())
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
    with pytest.raises(ConfigError, match="lies in none"):
        run_sql(root, "SELECT 1", "csv", tmp_path / "no" / "out.csv", io.StringIO())


def test_unknown_format_lists_the_valid_ones(root: Path) -> None:
    with pytest.raises(ConfigError, match="unknown format 'xml'; valid: csv, json, parquet, table"):
        answer(root, "SELECT 1", "xml")


class Refusing(io.StringIO):
    """A stream that stops the writer after its first lines."""

    def write(self, text: str) -> int:
        raise BrokenPipeError


def test_answers_are_streamed_and_the_streams_own_errors_stay_its_own(root: Path) -> None:
    # 10^12 rows are never held: the writer stops the query with the first batch
    with connect(root) as connection, pytest.raises(BrokenPipeError):
        write(query(connection, "SELECT i FROM range(1000000000000) t(i)"), "csv", Refusing())


def test_query_gives_batches(root: Path) -> None:
    with connect(root) as connection:
        reader = query(connection, "SELECT i FROM range(1000000000000) t(i)")
        assert isinstance(reader, pa.RecordBatchReader)
        assert 0 < reader.read_next_batch().num_rows <= 100_000
        reader.close()


def test_a_query_does_not_disturb_the_views(root: Path) -> None:
    with connect(root) as connection:
        for _ in range(3):
            assert query(connection, "SELECT count(*) AS n FROM runs").read_all().to_pylist() == [{"n": 2}]
        assert isinstance(connection, duckdb.DuckDBPyConnection)
