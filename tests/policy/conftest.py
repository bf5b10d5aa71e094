"""Fakes for tests of the training loop."""

import pytest

from stages.policy import group
from stages.sim.config import WorldConfig
from tests.fake_worlds import FakeEstimator, FakeWorlds


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> dict[int, int]:
    """Replace worlds and estimator by fakes; the returned dict says which world diverges at which step."""
    diverge: dict[int, int] = {}

    def make(config: WorldConfig, task: str, n: int, view: object, workers: int) -> FakeWorlds:
        worlds = FakeWorlds(n, task, 32 if view else None)
        worlds.diverge_at = diverge
        return worlds

    monkeypatch.setattr(group, "WorldPool", make)
    monkeypatch.setattr(group.Estimator, "load", lambda *_, **__: FakeEstimator())
    return diverge
