"""Where the cube starts, how wrong the estimate is there, and the return lost against the oracle."""

from pathlib import Path
from typing import Any

import pytest

from schemas import tables
from schemas.files import write_parquet
from schemas.progress import Silent
from stages.analyze.region_sentences import region_sentences
from stages.analyze.study import ask_all, choose
from tests.analyze.fake_artifacts import table, write_manifest

EPISODES = [  # x, y [m], estimation error [m], reward error, return of the oracle and of dense
    (-0.15, -0.15, 0.01, 0.1, 180.0, 175.0),
    (0.15, 0.15, 0.05, 0.3, 170.0, 100.0),
    (0.14, 0.13, 0.03, 0.2, 160.0, 150.0),
]


def write_final(root: Path, scheme: str) -> None:
    """A run of seed 0 with the final episodes above, of two steps each."""
    cell = f"reach-{scheme}-orbit05-seed0"
    directory = root / "runs" / "main" / cell
    (directory / "transitions").mkdir(parents=True)
    identity = {"task": "reach", "scheme": scheme, "misalignment_kind": "orbit", "misalignment_deg": 5.0, "seed": 0}
    common = {"run": f"main/{cell}", **identity, "split": "final"}
    episodes: list[dict[str, Any]] = []
    steps: list[dict[str, Any]] = []
    for number, (x, y, error, reward_error, best, ours) in enumerate(EPISODES):
        of_episode = common | {"episode": number}
        value = best if scheme == "oracle" else ours
        episodes.append(of_episode | {"return_dense_true": value, "mean_estimation_error": error, "length": 2})
        for step, sign in enumerate((1, -1)):  # the cube is pushed away after the first step
            rewards = {"reward_dense_true": 0.5, "reward_dense_est": 0.5 + sign * reward_error}
            place = {"cube_true_x": x * sign, "cube_true_y": y * sign}
            steps.append(of_episode | {"step": step, "observation": [0.0], "action": [0.0]} | place | rewards)
    write_parquet(table(episodes, tables.EPISODES), directory / "episodes.parquet")
    write_parquet(table(steps, tables.transitions(1, 1)), directory / "transitions" / "part-00000.parquet")
    config = {"run": identity, "world": {"cube_half_range": 0.15}}
    write_manifest(directory, f"runs/main/{cell}", config, {})


def answers(root: Path, name: str) -> list[dict[str, Any]]:
    return ask_all(root, choose(root, [], []), Silent())[name].rows


def test_lost_return_is_the_oracle_s_from_the_same_start(tmp_path: Path) -> None:
    for scheme in ("oracle", "dense"):
        write_final(tmp_path, scheme)
    dense = [row for row in answers(tmp_path, "regions") if row["scheme"] == "dense"]
    near, far = dense
    assert (near["x"], near["y"], near["width"]) == pytest.approx((-0.12, -0.12, 0.06))
    assert (far["x"], far["y"]) == pytest.approx((0.12, 0.12))  # the edge belongs to the last region
    assert (near["episodes"], far["episodes"]) == (1, 2)
    assert far["estimation_error"] == pytest.approx(0.04)
    assert far["reward_error"] == pytest.approx(0.25)
    assert (near["mean_return"], far["mean_return"]) == (175.0, 125.0)
    assert (near["lost_return"], far["lost_return"]) == (5.0, 40.0)  # (70 + 10) / 2
    oracle = [row for row in answers(tmp_path, "regions") if row["scheme"] == "oracle"]
    assert [row["lost_return"] for row in oracle] == [0.0, 0.0]


def test_without_an_oracle_nothing_is_known_to_be_lost(tmp_path: Path) -> None:
    write_final(tmp_path, "dense")
    assert [row["lost_return"] for row in answers(tmp_path, "regions")] == [None, None]
    assert [row["compared"] for row in answers(tmp_path, "regions")] == [0, 0]
    assert answers(tmp_path, "region-correlation") == []


def test_only_compared_episodes_are_behind_a_lost_return(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_final(tmp_path, "dense")
    monkeypatch.setattr(f"{__name__}.EPISODES", EPISODES[:2])
    write_final(tmp_path, "oracle")
    dense = [row for row in answers(tmp_path, "regions") if row["scheme"] == "dense"]
    assert [(row["episodes"], row["compared"], row["lost_return"]) for row in dense] == [(1, 1, 5.0), (2, 1, 70.0)]


def test_regions_are_named_by_enough_compared_episodes() -> None:
    common = {"name": "main", "task": "reach", "misalignment_kind": "orbit", "misalignment_deg": 5.0, "y": 0.0}
    common |= {"scheme": "dense", "estimation_error": 0.02, "episodes": 50}
    made = [
        common | {"x": x, "lost_return": lost, "compared": n} for x, lost, n in ((0, 1, 10), (0.1, 5, 12), (0.2, 99, 9))
    ]
    (sentence,) = region_sentences(made)
    assert "most is lost at x = +10 cm, y = 0 cm (5.0 of return, estimate 2.0 cm off, 12 episodes)" in sentence


def test_correlation_is_of_ranks(tmp_path: Path) -> None:
    """Errors 0.01 < 0.03 < 0.05 against losses 5 < 10 < 70: the same order, though far from a line."""
    for scheme in ("oracle", "dense"):
        write_final(tmp_path, scheme)
    (row,) = answers(tmp_path, "region-correlation")
    assert (row["scheme"], row["episodes"]) == ("dense", 3)
    assert row["estimation_correlation"] == pytest.approx(1.0)
    assert row["reward_correlation"] == pytest.approx(1.0)
    assert row["lost_return"] == pytest.approx(85 / 3)


def test_ties_share_their_rank_and_constants_have_no_correlation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ranks of the errors 1.5, 1.5, 3 against 1, 2, 3: Pearson's of those is √3 / 2."""
    tied = [(0.0, 0.0, 0.01, 0.1, 100.0, 99.0), (0.0, 0.0, 0.01, 0.1, 100.0, 98.0), (0.0, 0.0, 0.02, 0.1, 100.0, 97.0)]
    monkeypatch.setattr(f"{__name__}.EPISODES", tied)
    for scheme in ("oracle", "dense"):
        write_final(tmp_path, scheme)
    (row,) = answers(tmp_path, "region-correlation")
    assert row["estimation_correlation"] == pytest.approx(3**0.5 / 2)
    assert row["reward_correlation"] is None
