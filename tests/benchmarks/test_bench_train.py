"""The benchmarks against the public packages run, and give figures that can be compared."""

import pytest

pytest.importorskip("stable_baselines3", reason="the benchmarks' packages: make bench")

from benchmarks import scaling, td3, train


def test_train() -> None:
    outcome = train.run(quick=True)
    ratio, memory, _ = outcome.targets
    assert ratio.value > 0 and memory.value > 0
    assert len(outcome.rounds["ours"]) == len(outcome.rounds["stock"]) == 2
    assert {part.name for part in outcome.parts} >= {"physics", "control", "render", "inference", "update"}
    assert 0 < outcome.figures["fraction of the limit"] < 1


def test_td3() -> None:
    outcome = td3.run(quick=True)
    assert outcome.targets[0].value > 0
    assert set(outcome.rounds) == {"ours, 12 runs", "stock", "ours, 12 runs, float32", "ours, 1 run"}
    assert outcome.as_json()["limit_ms"] > 0


def test_scaling() -> None:
    table = scaling.run(quick=True).table
    assert [(row["runs"], row["processes"]) for row in table] == [(1, 1), (2, 1), (2, 2)]
    assert all(row["steps/s"] > 0 for row in table)
