"""The query benchmark asks a real study, written by the project's own log."""

import pytest

from benchmarks import query
from benchmarks.analyst import QUESTIONS


def test_outcome() -> None:
    outcome = query.run(quick=True)
    assert [target.name for target in outcome.targets] == [*QUESTIONS, "peak memory"]
    assert all(target.value > 0 for target in outcome.targets)
    assert outcome.figures["transitions"] == 16 * 20 * 60
    assert outcome.figures["part files"] == 16
    answered = {row["question"]: row["rows"] for row in outcome.table}
    assert answered["return by scheme"] == 16
    assert answered["worst episodes"] == 20
    assert answered["switch effect"] == 4
    assert answered["error by misalignment"] == 3
    assert [part.milliseconds for part in outcome.parts] == pytest.approx([1e3 * t.value for t in outcome.targets[:-1]])
