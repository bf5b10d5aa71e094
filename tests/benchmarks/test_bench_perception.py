"""The perception benchmark collects, trains and tests on both renderers' frames."""

from benchmarks import perception


def test_outcome() -> None:
    outcome = perception.run(quick=True)
    path, error = outcome.targets
    assert path.value > 0 and error.value > 0
    assert path.value < outcome.figures["real training / one batch in memory, without decoding"]
    assert 0 < outcome.figures["error on fast frames, cm"] < 100
    assert outcome.figures["error on fast frames, cm"] != outcome.figures["error on stock frames, cm"]
    assert set(outcome.rounds) == {"real training", "one batch in memory"}
