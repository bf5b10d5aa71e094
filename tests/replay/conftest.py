"""Runs to replay: one that stays as it is, and fresh ones to damage."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.replay.tiny_run import make_dataset, make_run


@pytest.fixture(scope="session")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete run; not to be changed."""
    return make_run(tmp_path_factory.mktemp("data"))


@pytest.fixture
def fresh_run(tmp_path: Path) -> Callable[..., Path]:
    """Makes a run that the test may damage."""
    return lambda **options: make_run(tmp_path / "data", **options)


@pytest.fixture(scope="session")
def dataset_dir(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of one episode, of which every frame was kept; not to be changed."""
    return make_dataset(run_dir, tmp_path_factory.mktemp("datasets") / "tiny")
