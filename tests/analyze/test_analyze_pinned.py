"""A query reads the files that were there when it began, whatever takes their names meanwhile."""

import os
import resource
from collections.abc import Iterator
from pathlib import Path

import duckdb
import pyarrow as pa
import pytest

from schemas.files import write_parquet
from stages.analyze.pinned import Pinned
from stages.analyze.views import connect
from tests.analyze.fake_runs import write_run


@pytest.fixture
def few_files() -> Iterator[None]:
    """No more open files than there are now and sixteen, until somebody asks for more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 16, hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_what_takes_a_file_s_place_is_not_seen(tmp_path: Path) -> None:
    file = tmp_path / "a.parquet"
    write_parquet(pa.table({"a": [1, 2, 3]}), file)
    pinned = Pinned()
    [name] = pinned.names([file, tmp_path / "gone.parquet"])
    write_parquet(pa.table({"a": [9]}), file)
    assert duckdb.sql(f"SELECT sum(a) FROM read_parquet('{name}')").fetchall() == [(6,)]
    pinned.close()
    assert pinned.directories() == []


@pytest.mark.usefixtures("few_files")
def test_more_files_than_a_process_has_by_default(tmp_path: Path) -> None:
    write_parquet(pa.table({"a": [1]}), tmp_path / "a.parquet")
    pinned = Pinned()
    assert len(set(pinned.names([tmp_path / "a.parquet"] * 100))) == 100
    pinned.close()


def test_a_run_that_grows_while_it_is_asked_about(tmp_path: Path) -> None:
    """All views are of the moment of the connection; what they keep open is let go with it."""
    run = write_run(tmp_path, status="running", episodes=20)
    before = len(os.listdir("/proc/self/fd"))
    with connect(tmp_path) as connection:
        [(rows,)] = connection.sql("SELECT count(*) FROM transitions").fetchall()
        [(told,)] = connection.sql("SELECT count(*) FROM episodes").fetchall()
        for path in (*(run / "transitions").iterdir(), run / "episodes.parquet"):
            path.unlink()
        assert connection.sql("SELECT count(*) FROM transitions").fetchall() == [(rows,)] and rows > 0
        assert connection.sql("SELECT count(*) FROM episodes").fetchall() == [(told,)] and told > 0
    del connection
    assert len(os.listdir("/proc/self/fd")) == before
