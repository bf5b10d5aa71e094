"""The benchmark of what is asked after the fact works on real runs and a real study."""

from benchmarks import afterwards


def test_outcome() -> None:
    outcome = afterwards.run(quick=True)
    values = {target.name: target.value for target in outcome.targets}
    assert all(value > 0 for value in values.values())
    assert values["recording of an episode"] < 10
    assert values["replay without frames"] > 1
    assert outcome.figures == {"transitions": 4 * 20 * 60, "runs": 4}
