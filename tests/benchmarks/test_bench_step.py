"""The step benchmark runs and compares like with like."""

from benchmarks import step


def test_outcome() -> None:
    outcome = step.run(quick=True)
    ratio, difference = outcome.targets
    assert ratio.value > 0
    assert difference.value <= step.TOLERANCE and difference.met
    assert set(outcome.rounds) == {"ours", "stock", "bare mj_step"}
    assert all(rate > 0 for rates in outcome.rounds.values() for rate in rates)
    assert outcome.figures["fraction of the limit"] > 0
    assert outcome.limit_ms == outcome.parts[0].limit
