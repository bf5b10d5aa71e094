"""The frame benchmark runs, and finds frames near robosuite's."""

import stages.sim  # noqa: F401  # chooses the OpenGL backend before MuJoCo is imported
from benchmarks import render


def test_quick_run_has_ratios_parts_and_a_limit() -> None:
    """Small sizes; nothing here depends on how fast the machine is."""
    outcome = render.run(quick=True)
    ratio, difference = outcome.targets
    assert ratio.value > 0 and ratio.bound == 8
    assert 0.1 < difference.value <= difference.bound, "no difference at all: stock was not drawn"
    assert set(outcome.rounds) == {"ours 128²", "ours 64²", "stock 128²", "stock 64²"}
    assert all(rate > 0 for rates in outcome.rounds.values() for rate in rates)
    assert all(part.milliseconds > 0 for part in outcome.parts) and outcome.limit_ms
    assert outcome.figures["fraction of the limit"] > 0
    turned = [value for name, value in outcome.figures.items() if name.endswith("°")]
    assert len(turned) == 8 and max(turned) < 3
    assert outcome.as_json()["targets"][0]["name"] == "ours / stock"
