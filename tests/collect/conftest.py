"""One small real dataset for the tests that look at what collect writes."""

from pathlib import Path
from typing import Any

import pytest

from schemas.progress import Silent
from stages.collect.config import CollectStageConfig
from stages.collect.run import run
from tests.collect.small_dataset import CONFIG, DATASET, write_manifest


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four real episodes at 128 pixels, with their manifest."""
    out = tmp_path_factory.mktemp("datasets") / DATASET
    out.mkdir()
    write_manifest(out, CONFIG, run(CONFIG, out, dataset=DATASET, progress=Silent()))
    return out


@pytest.fixture
def collect(tmp_path: Path) -> Any:
    """Collects a configuration into a fresh directory; call again to resume."""

    def call(config: CollectStageConfig, **options: Any) -> dict[str, Any]:
        out = tmp_path / "out"
        out.mkdir(exist_ok=True)
        return run(config, out, dataset="d", progress=options.pop("progress", Silent()), **options)

    return call
