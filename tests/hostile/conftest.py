"""The ground of all hostile cases, and how many there were."""

import os
from collections.abc import Iterator

import pytest

from tests.hostile.ground import CASES, Ground
from tests.hostile.stock import make_stock

WANTED = 2000
"""Cases of the long profile."""
IS_LONG = os.environ.get("HYPOTHESIS_PROFILE") == "long"


@pytest.fixture(scope="session")
def stocked(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    """A data root with an artifact of every kind."""
    made = Ground(tmp_path_factory.mktemp("guard"))
    make_stock(made.data)
    return made


@pytest.fixture(scope="module")
def ground(stocked: Ground) -> Iterator[Ground]:
    """The same, as the working directory: what a command writes beside itself is seen. Who damages it puts it back."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(stocked.guard)
        yield stocked


def pytest_sessionfinish(session: pytest.Session) -> None:
    """The long suite is what it says only with enough cases; a selection of it may have fewer."""
    chosen = session.config.option.keyword or any("::" in each for each in session.config.args)
    if IS_LONG and not chosen and 0 < CASES.total() < WANTED:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """How many hostile inputs were generated, by kind."""
    if CASES:
        by_kind = ", ".join(f"{kind} {count}" for kind, count in sorted(CASES.items()))
        wanted = f" (at least {WANTED} are wanted)" if IS_LONG else ""
        terminalreporter.write_line(f"{CASES.total()} hostile cases{wanted}: {by_kind}")
