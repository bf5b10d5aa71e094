"""The collect benchmark runs, and stock does and sees what was collected."""

import pytest

from benchmarks import collect


def test_outcome() -> None:
    outcome = collect.run(quick=True)
    ratio, writing = outcome.targets
    assert ratio.value > 0
    assert 0 < writing.value < 1
    assert outcome.figures["largest difference of qpos"] <= 1e-9
    assert outcome.figures["mean difference of the pixels (of 255)"] < 10
    assert sum(part.milliseconds for part in outcome.parts) > 0
    assert outcome.limit_ms == pytest.approx(sum(part.limit or 0 for part in outcome.parts) / outcome.cores)
