"""Queries that write, read elsewhere or load something: refused, nothing written, nothing told."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from schemas.manifest import config_sha256
from tests.hostile.cases import cases
from tests.hostile.ground import Ground
from tests.hostile.stock import LEARNT

SECRET = "none of a command's business"
READS = (
    *("'{outside}'", "read_csv('{outside}')", "read_text('{outside}')", "read_blob('{outside}')", "glob('{guard}/*')"),
    *("read_json('{outside}')", "read_parquet('{outside}')", "sniff_csv('{outside}')", "parquet_metadata('{outside}')"),
    *("read_csv_auto('{data}/../outside.txt')", "read_csv(['{data}/runs', '{outside}'])", "'file://{outside}'"),
    *("read_text('/proc/self/environ')", "'/etc/passwd'", "read_csv('/etc/passwd', columns={{'a': 'VARCHAR'}})"),
    *("query('FROM read_text(''{outside}'')')", "query_table('runs')", "duckdb_settings()", "duckdb_secrets()"),
    *(
        "pragma_database_list()",
        "which_secret('x', 's3')",
        "arrow_scan(1, 2, 3)",
        "pandas_scan(1)",
        "python_map_function()",
    ),
    *("json_execute_serialized_sql(json_serialize_sql('SELECT 1'))", "'http://127.0.0.1:9/x.parquet'", "'s3://x/y'"),
    *(
        "read_duckdb('{outside}')",
        "sqlite_scan('{outside}', 'x')",
        "postgres_scan('x', 'y', 'z')",
        "load_aws_credentials()",
    ),
    *("duckdb_logs()", "duckdb_temporary_files()", "duckdb_memory()", "test_all_types()", "repeat_row(1, num_rows=1)"),
)
EXPRESSIONS = (
    *("getenv('HOME')", "getvariable('x')", "current_setting('temp_directory')", "read_text('{outside}')"),
    *("(SELECT content FROM read_text('{outside}'))", "nextval('x')", "add_parquet_key('a', 'b')"),
    *(
        "list_transform([1], x -> (SELECT content FROM read_text('{outside}')))",
        "finalize('x')",
        "set_config('a', 'b')",
    ),
    *("list_transform(['{outside}'], lambda x: getenv(x))", "pg_read_file('{outside}')", "enable_logging()"),
)
STATEMENTS = (
    *("COPY (SELECT 1) TO '{guard}/canary'", "COPY runs TO '{data}/x.csv'", "COPY runs FROM '{outside}'"),
    *(
        "ATTACH '{guard}/canary' AS x",
        "ATTACH ':memory:' AS x",
        "DETACH memory",
        "USE memory",
        "INSTALL httpfs",
        "LOAD httpfs",
    ),
    *(
        "FORCE INSTALL httpfs FROM 'http://127.0.0.1:9'",
        "PRAGMA database_list",
        "PRAGMA enable_profiling",
        "PRAGMA version",
    ),
    *(
        "SET memory_limit = '1TB'",
        "SET enable_external_access = true",
        "RESET lock_configuration",
        "SET VARIABLE x = 1",
    ),
    *(
        "EXPORT DATABASE '{guard}/canary'",
        "IMPORT DATABASE '{guard}'",
        "CREATE TABLE x AS SELECT 1",
        "CREATE VIEW v AS SELECT 1",
    ),
    *("CREATE MACRO m() AS 1", "CREATE OR REPLACE MACRO iqm(x) AS 1", "CREATE SECRET s (TYPE s3)", "CREATE SCHEMA s"),
    *(
        "DROP TABLE runs",
        "DELETE FROM runs",
        "UPDATE runs SET seed = 1",
        "INSERT INTO runs (run) VALUES ('x')",
        "TRUNCATE runs",
    ),
    *(
        "ALTER TABLE runs ADD COLUMN x INT",
        "VACUUM",
        "CHECKPOINT",
        "ANALYZE",
        "BEGIN",
        "CALL pragma_version()",
        "PREPARE p AS SELECT 1",
    ),
    *(
        "EXECUTE p",
        "COMMENT ON TABLE runs IS 'x'",
        "MERGE INTO runs USING runs r ON true WHEN MATCHED THEN DELETE",
        "KILL 1",
    ),
    *("EXPLAIN ANALYZE COPY (SELECT 1) TO '{guard}/canary'", "WITH a AS (COPY (SELECT 1) TO '{guard}/canary') FROM a"),
    *(
        "SELECT 1; COPY (SELECT 1) TO '{guard}/canary'",
        "WITH a AS (DELETE FROM runs RETURNING *) FROM a",
        ".shell touch canary",
    ),
)


def _filled(ground: Ground, text: str) -> str:
    return text.format(outside=ground.guard / "outside.txt", guard=ground.guard, data=ground.data)


def _disguised(text: str, disguise: str) -> str:
    shapes = {
        "plain": text,
        "comment before": f"-- harmless\n/* /* nested */ */ {text}",
        "comment behind": f"{text} -- harmless",
        "semicolons": f";;{text};;",
        "in a CTE": f"WITH runs AS (FROM runs) {text}",
        "after a query": f"SELECT 1; {text}",
        "upper": text.replace("select", "SELECT").replace("read_", "READ_"),
        "no-break spaces": text.replace(" ", " "),
        "explained": f"EXPLAIN ANALYZE {text}",
        "in braces": f"({text})",
    }
    return shapes[disguise]


DISGUISES = st.sampled_from(
    ["plain", "comment before", "comment behind", "semicolons", "in a CTE", "after a query", "upper", "no-break spaces",
     "explained", "in braces"]
)  # fmt: skip


@cases(12, 250)
@given(st.sampled_from(STATEMENTS), DISGUISES)
def test_what_does_more_than_read(ground: Ground, statement: str, disguise: str) -> None:
    with ground.case("statements"):
        ground.refused("sql", _disguised(_filled(ground, statement), disguise), codes=(2,))


SHAPES = (
    *("FROM {}", "SELECT count(*) FROM {}", "FROM runs, {}", "DESCRIBE FROM {}", "SUMMARIZE FROM {}"),
    *("SELECT (SELECT count(*) FROM {})", "FROM (FROM {}) UNION ALL FROM (FROM {})"),
)
HARMLESS = ("duckdb_settings()", "query_table('runs')", "test_all_types()", "repeat_row(1, num_rows=1)")
"""They tell nothing that is not the caller's."""


@cases(12, 250)
@given(st.sampled_from(READS), st.sampled_from(SHAPES), DISGUISES)
@example("glob('{guard}/*')", "FROM {}", "plain")
def test_what_reads_elsewhere(ground: Ground, source: str, shape: str, disguise: str) -> None:
    query = _disguised(shape.replace("{}", _filled(ground, source)), disguise)
    with ground.case("reads"):
        result = ground.call("sql", query, "--format", "csv")
        assert SECRET not in result.output and "root:" not in result.output
        assert result.exit_code == 2 or source in HARMLESS or "glob" in source or "EXPLAIN" in query, result.output
        assert "outside" not in result.stdout


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_expressions_that_know_too_much(ground: Ground, expression: str) -> None:
    with ground.case("expressions"):
        result = ground.call("sql", f"SELECT {_filled(ground, expression)} AS x", "--format", "csv")
        assert SECRET not in result.output and "/root" not in result.stdout
        assert result.exit_code == 2 or "current_setting" in expression or "getvariable" in expression, result.stdout


@cases(10, 200)
@given(st.text(max_size=80))
@example("SELECT 1 -- \0")
@example("\0")
@example("(" * 1_000 + "1" + ")" * 1_000)
@example("SELECT " + "- " * 3_000 + "1")
@example("SELECT " + "+".join("1" * 2_000))
@example("SELECT " + "(SELECT " * 500 + "1" + ")" * 500)
def test_texts_that_are_no_query(ground: Ground, text: str) -> None:
    with ground.case("no queries"):
        ground.ask("sql", "--data", str(ground.data), "--", text)
        ground.call("sql", input=text.encode("utf-8", "surrogatepass"))


def test_queries_that_are_no_text(ground: Ground) -> None:
    for data in (b"\xff\xfe", b"SELECT '\xff'", b"\0" * 1000):
        with ground.case("no queries"):
            ground.refused("sql", input=data, codes=(2,))


def test_the_answer_is_written_where_it_is_asked_for_and_nowhere_else(ground: Ground) -> None:
    with ground.case("answers"):
        assert ground.call("sql", "FROM runs", "-o", "out/runs.csv").exit_code == 0
        for target in ("/", "nowhere/x.csv", "/proc/x.csv", "out", "out/" + "x" * 300 + ".csv"):
            ground.refused("sql", "FROM runs", "-o", target, codes=(2, 4))


def test_a_name_is_data_in_every_view(ground: Ground) -> None:
    """The identity of a run comes from its manifest: quotes in it end no literal."""
    injected = "x'); DROP TABLE runs; --"

    def edit(fields: dict) -> None:
        fields["config"]["run"]["task"] = injected
        fields["config"]["estimator"] = injected
        fields["config_sha256"] = config_sha256(fields["config"])

    with ground.edited(LEARNT, edit), ground.case("injections"):
        found = ground.call("sql", "SELECT task, estimator FROM runs ORDER BY run", "--format", "csv").stdout
        assert f"{injected},{injected}" in found
        assert "table" not in ground.call("sql", "SELECT count(*) FROM transitions", "--format", "csv").stderr
