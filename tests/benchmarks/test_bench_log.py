"""The log benchmark trains for real, and what it wraps it unwraps."""

from benchmarks import log
from stages.policy.log import RunLog


def test_outcome() -> None:
    flush = RunLog.flush
    outcome = log.run(quick=True)
    share, size = outcome.targets
    assert 0 < share.value < 1
    assert size.value > 100, "the numbers of a transition do not fit into that"
    assert outcome.figures["transitions"] == 2 * 10 * 4  # runs × steps × (two training, an evaluation, a final episode)
    assert {part.name for part in outcome.parts} == {
        f"log ({name})" for name in ("set", "of_run", "add_transitions", "flush", "add")
    }
    assert RunLog.flush is flush
