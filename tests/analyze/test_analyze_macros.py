"""The macros of `pipeline sql` against values by hand and against the report's own statistics."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.columns import documented, meaning
from schemas.errors import ConfigError
from stages.analyze.config import AnalyzeConfig
from stages.analyze.describe import views
from stages.analyze.macros import macros
from stages.analyze.query import run_sql
from stages.analyze.statistics import Statistics
from tests.analyze.fake_runs import write_run

NUMBERS = st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=9)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("macros") / "data"
    for seed in (0, 1, 2):
        write_run(data, seed=seed, episodes=40)
    write_run(data, scheme="sparse", seed=0, episodes=60, final=False)
    return data


def rows(root: Path, sql: str) -> list[dict[str, Any]]:
    stream = io.StringIO()
    run_sql(root, sql, "json", None, stream)
    return list(json.loads(stream.getvalue()))


def value(root: Path, expression: str) -> Any:
    [row] = rows(root, f"SELECT {expression} AS x")
    return row["x"]


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ("[1, 2, 3, 4]", 2.5),
        ("[8, 1, 3, 2]", 2.5),  # the lowest and the highest quarter are left out
        ("[1, 2, 10]", (0.25 * 1 + 1 * 2 + 0.25 * 10) / 1.5),  # the edges count by their share that lies inside
        ("[5]", 5),
        ("[1, NULL, 3, 'nan'::DOUBLE]", 2),
        ("[]", None),
    ],
)
def test_interquartile_mean_by_hand(root: Path, numbers: str, expected: float | None) -> None:
    found = value(root, f"iqm({numbers}::DOUBLE[])")
    assert found is expected if expected is None else found == pytest.approx(expected)


@settings(max_examples=20, deadline=None)
@given(NUMBERS)
def test_statistics_are_the_reports(root: Path, numbers: list[float]) -> None:
    summary = Statistics(AnalyzeConfig()).of(numbers)
    assert summary is not None
    assert value(root, f"iqm({numbers})") == pytest.approx(summary.iqm)
    for found, low, high in (
        (value(root, f"mean_interval({numbers})"), summary.low, summary.high),
        (value(root, f"iqm_interval({numbers})"), summary.iqm_low, summary.iqm_high),
    ):
        assert (None if low is None else pytest.approx([low, high])) == found


def test_a_narrower_confidence_lies_inside(root: Path) -> None:
    wide, narrow = (value(root, f"iqm_interval([1, 5, 6, 7, 20], confidence := {c})") for c in (0.95, 0.5))
    assert wide[0] < narrow[0] < narrow[1] < wide[1]


def test_one_number_has_no_interval(root: Path) -> None:
    assert value(root, "mean_interval([5.0])") is None
    assert value(root, "iqm_interval([5.0, NULL])") is None


def test_runs_end_with_the_final_evaluation_or_the_last_one(root: Path) -> None:
    found = {row["run"]: (row["split"], row["after_episode"]) for row in rows(root, "FROM outcomes()")}
    assert len(found) == 4
    assert found.pop("study/reach-sparse-orbit00-seed0") == ("eval", 60)
    assert set(found.values()) == {("final", 40)}


def test_a_confidence_that_is_none_is_refused(root: Path) -> None:
    with pytest.raises(ConfigError, match="confidence is between 0 and 1, not 95"):
        value(root, "iqm_interval([1.0, 2.0], confidence := 95)")


def test_return_by_scheme_is_over_seeds(root: Path) -> None:
    [dense2sparse] = rows(root, "FROM return_by_scheme() WHERE scheme = 'dense2sparse'")
    ends = [row["mean_return"] for row in rows(root, "FROM outcomes() WHERE scheme = 'dense2sparse'")]
    assert dense2sparse["seeds"] == 3
    assert dense2sparse["return"] == pytest.approx(np.mean(ends))
    assert dense2sparse["return_interval"][0] <= np.mean(ends) <= dense2sparse["return_interval"][1]


def test_reward_error_is_that_of_the_transitions(root: Path) -> None:
    found = rows(root, "FROM reward_error_by_distance(width := 0.1)")
    [total] = rows(root, "SELECT count(reward_dense_est) AS n FROM transitions")
    assert sum(row["steps"] for row in found) == total["n"]
    assert all(row["distance"] / 0.1 % 1 == pytest.approx(0.5) for row in found)


@pytest.mark.parametrize("macro", macros(), ids=lambda macro: macro.name)
def test_every_macro_says_what_it_is_and_its_example_works(root: Path, macro: Any) -> None:
    assert macro.meaning
    rows(root, macro.example)


def test_every_column_is_described_and_nothing_else() -> None:
    known = {view: [column.name for column in columns] for view, columns in views().items()}
    assert all(meaning(view, name) for view, names in known.items() for name in names)
    everywhere = {name for names in known.values() for name in names}
    for view, names in documented().items():
        assert set(names) <= (everywhere if view == "common" else set(known[view])), view
