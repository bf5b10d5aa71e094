"""What every evidence is checked for."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from stages.analyze.evidence import recompute
from stages.analyze.results import Row


def committed(directory: Path, name: str) -> list[Row]:
    """The rows of a table of the evidence in `directory`."""
    return pq.read_table(directory / "tables" / f"{name}.parquet").to_pylist()


def read_me(out: Path) -> str:
    """Its README."""
    return (out / "README.md").read_text(encoding="utf-8")


def assert_follows(directory: Path) -> None:
    """Derived tables and README.md are what the answers make them."""
    tables, readme = recompute(directory)
    derived = {path.stem for path in (directory / "tables").glob("*.parquet") if not path.with_suffix(".sql").exists()}
    assert set(tables) == derived
    for name, rows in tables.items():
        for row, expected in zip(rows, committed(directory, name), strict=True):
            assert row.keys() == expected.keys()
            for key, value in row.items():
                number = isinstance(value, float)
                assert expected[key] == (pytest.approx(value, rel=1e-9, nan_ok=True) if number else value), (name, key)
    assert (directory / "README.md").read_text(encoding="utf-8") == readme
