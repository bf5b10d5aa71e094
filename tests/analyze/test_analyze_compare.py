"""Runs side by side: groups, how sure a difference is, and the settings that differ."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from schemas.errors import ArtifactError, ConfigError
from stages.analyze.compare import compare
from stages.analyze.compare_page import save_comparison
from stages.analyze.config import AnalyzeConfig
from stages.analyze.statistics import Statistics, probability_of_improvement
from tests.analyze.fake_runs import write_run
from tests.analyze.report_page import Page

RETURNS = st.lists(st.floats(0, 200), min_size=1, max_size=6).map(np.array)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    data = tmp_path / "data"
    for seed, (dense, switched) in enumerate([(100.0, 150.0), (110.0, 105.0), (120.0, 160.0)]):
        write_run(data, "a", scheme="dense", seed=seed, episodes=60, outcome=(dense, 0.5))
        write_run(data, "a", scheme="dense2sparse", seed=seed, episodes=60, outcome=(switched, 0.9))
        write_run(
            data, "b", scheme="dense2sparse", seed=seed, outcome=(90.0, 0.2), settings={"policy.buffer": "relabel"}
        )
    return data


def test_probability_of_improvement_by_hand() -> None:
    # of the nine pairs six are above, one is equal
    assert probability_of_improvement(np.array([1.0, 5.0, 6.0]), np.array([1.0, 2.0, 3.0])) == pytest.approx(6.5 / 9)


@given(RETURNS, RETURNS)
def test_one_side_improves_where_the_other_does_not(a: np.ndarray, b: np.ndarray) -> None:
    assert probability_of_improvement(a, b) + probability_of_improvement(b, a) == pytest.approx(1.0)
    assert probability_of_improvement(a, a) == pytest.approx(0.5)


def test_interval_holds_the_value_and_one_seed_has_none() -> None:
    statistics = Statistics(AnalyzeConfig())
    value, low, high = statistics.improvement([150, 105, 160], [100, 110, 120]) or (0.0, None, None)
    assert value == pytest.approx(7 / 9)
    assert low is not None and high is not None and low < value <= high
    assert statistics.improvement([2.0], [1.0]) == (1.0, None, None)
    assert statistics.improvement([2.0, 3.0], [1.0]) == (1.0, None, None), "one value has no spread to resample"
    assert statistics.improvement([], [1.0]) is None


def test_groups_are_in_the_order_of_the_names_and_the_first_is_the_measure(root: Path) -> None:
    found = compare(root, ["a", "b"], AnalyzeConfig())
    assert found.labels == ("a dense", "a dense2sparse", "b dense2sparse")
    switched, other = found.contests
    assert (switched.group, switched.baseline) == ("a dense2sparse", "a dense")
    assert switched.improvement == pytest.approx(7 / 9)
    assert switched.difference == pytest.approx((150 + 105 + 160) / 3 - 110)
    assert switched.seeds == 3
    assert other.improvement == 0.0
    assert compare(root, ["b", "a"], AnalyzeConfig()).labels[0] == "b dense2sparse"


def test_labels_name_only_what_differs(root: Path) -> None:
    assert compare(root, ["a"], AnalyzeConfig()).labels == ("dense", "dense2sparse")
    assert compare(root, ["a/reach-dense-orbit00-seed0"], AnalyzeConfig()).labels == ("dense",)


def test_settings_that_differ(root: Path) -> None:
    found = {each.key: each.values for each in compare(root, ["a", "b"], AnalyzeConfig()).settings}
    assert found["policy.buffer"] == ("keep", "keep", "relabel")
    assert found["policy.episodes"] == ("60", "60", "300")
    assert "policy.reset" not in found
    assert not any(key.startswith("run.") for key in found)


def test_failed_seeds_count_as_nothing(root: Path) -> None:
    write_run(root, "a", scheme="dense2sparse", seed=3, episodes=60, status="failed")
    [contest] = compare(root, ["a"], AnalyzeConfig()).contests
    assert contest.improvement == pytest.approx(7 / 12)


def test_unknown_names_and_runs_without_evaluation(root: Path) -> None:
    with pytest.raises(ArtifactError, match="no readable artifact 'c'"):
        compare(root, ["a", "c"], AnalyzeConfig())
    (write_run(root, "d", seed=0, episodes=20, status="running") / "evaluations.parquet").unlink()
    with pytest.raises(ArtifactError, match="none of these runs has been evaluated yet"):
        compare(root, ["d"], AnalyzeConfig())


def test_figure_as_page_picture_and_drawing(root: Path, tmp_path: Path) -> None:
    compared = compare(root, ["a", "b"], AnalyzeConfig())
    for suffix in (".html", ".png", ".svg"):
        save_comparison(compared, tmp_path / f"compared{suffix}")
    page = Page((tmp_path / "compared.html").read_text())
    assert not page.references
    said = re.sub(r"\s+", " ", page.text)
    assert "b dense2sparse" in said and "0.78" in said and "policy.buffer" in said and "relabel" in said
    assert len(json.loads(page.scripts[0])["figures"]["comparison"]) == 2
    assert "b dense2sparse" in (tmp_path / "compared.svg").read_text()
    with Image.open(tmp_path / "compared.png") as image:
        assert len(image.convert("RGB").getcolors(1 << 24) or []) > 50
    with pytest.raises(ConfigError, match=r"unknown suffix of a comparison '.pdf'; valid: .html, .png, .svg"):
        save_comparison(compared, tmp_path / "compared.pdf")
