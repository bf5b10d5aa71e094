"""An episode estimated again: by the same estimator it is the same, by another it is worth something else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.policy.config import RunConfig
from stages.policy.schemes import phase, reward_kind, select_reward
from stages.replay import relabelling
from stages.replay.export import export_episode
from stages.replay.frames import View
from stages.replay.logs import LoggedEpisode, load_episode
from stages.replay.reestimate import Eye, reestimate, what_if

SCHEMES = ("dense", "sparse", "oracle", "dense2sparse")


@pytest.fixture(scope="module")
def logged(run_dir: Path) -> LoggedEpisode:
    return load_episode(run_dir, "final", 0)


def again(logged: LoggedEpisode, estimate: np.ndarray) -> LoggedEpisode:
    return reestimate(logged, estimate, "x from pan 0°")


def test_the_same_estimates_change_nothing(logged: LoggedEpisode) -> None:
    same = again(logged, logged.vector("cube_est"))
    for column in ("distance_est", "estimation_error", "reward_dense_est"):
        np.testing.assert_allclose(same.rows[column], logged.rows[column], atol=1e-6)
    found = what_if(logged, same)
    assert found.moved == 0.0
    assert found.error == pytest.approx(found.error_logged)
    assert found.return_dense_est == pytest.approx(found.return_dense_est_logged, abs=1e-4)


def test_estimates_five_centimetres_off(logged: LoggedEpisode) -> None:
    off = again(logged, logged.vector("cube_true") + np.array([0.03, 0.0, 0.04]))
    np.testing.assert_allclose(off.rows["estimation_error"], 0.05, atol=1e-6)
    distance = np.linalg.norm(logged.vector("eef") - off.vector("cube_est"), axis=1)
    dense = np.where(distance <= 0.03, 1.0, 1.0 - np.tanh(10.0 * distance))  # equation 3
    np.testing.assert_allclose(off.rows["reward_dense_est"], dense, atol=1e-5)
    assert off.summary["return_dense_est"] == pytest.approx(dense.sum(), abs=1e-4)
    assert what_if(logged, off).error == pytest.approx(0.05)
    assert np.array_equal(off.rows["reward_dense_true"], logged.rows["reward_dense_true"])
    assert off.reestimated == "x from pan 0°"


def test_an_estimator_sees_its_own_image_size_whatever_is_saved(run_dir: Path, tmp_path: Path) -> None:
    shapes: list[tuple[int, ...]] = []

    def predict(frames: np.ndarray) -> np.ndarray:
        shapes.append(frames.shape)
        return np.zeros((len(frames), 3))

    save = tmp_path / "x.mp4"
    view = View(image_size=96, misalignment_deg=0.0)
    result, found = export_episode(run_dir, "final", 0, save, view=view, eye=Eye("x", 48, predict))
    assert result.identical
    assert shapes == [(20, 48, 48, 3)]
    assert save.is_file()
    assert found is not None and found.estimated_by == "x from orbit 0°"
    assert "estimated again by x from orbit 0°" in found.message()


@given(
    scheme=st.sampled_from(SCHEMES),
    switch=st.integers(0, 6),
    trained=st.lists(st.integers(0, 9), min_size=1, max_size=8),
    split=st.sampled_from(["train", "eval", "final"]),
)
def test_reward_and_phase_are_those_of_training(scheme: Any, switch: int, trained: list[int], split: str) -> None:
    n, horizon = len(trained), 200
    rng = np.random.default_rng(n)
    rows = {f"reward_{term}": rng.random(n) for term in ("dense_true", "dense_est", "sparse")}
    number = np.array(trained)
    rows["split"] = np.full(n, split)
    rows["episode"] = number if split == "train" else np.zeros(n, int)
    rows["global_step"] = (number if split == "train" else number + 1) * horizon
    run_config = RunConfig(switch_episode=switch, warmup_episodes=2)
    policy = {"switch_episode": switch, "warmup_episodes": 2}
    config = {"run": {"scheme": scheme}, "world": {"horizon": horizon}, "policy": policy}
    found, phases = relabelling.used(config, rows), relabelling.phases(config, rows)
    for row, episode in enumerate(trained):
        kind = reward_kind(scheme, episode, run_config)
        assert phases[row] == phase(scheme, episode, run_config)
        parts = [rows[f"reward_{term}"][row : row + 1] for term in ("dense_true", "dense_est", "sparse")]
        assert found[row] == select_reward(scheme, kind, *parts)[0]
