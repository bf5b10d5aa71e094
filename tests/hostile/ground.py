"""The oracle of every hostile case: how a command may end, and what may have happened to the disk meanwhile."""

import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from pipeline.cli import cli

CODES = (0, 2, 3, 4)
LONGEST = 1500  # characters of a message that is still short
CASES: Counter[str] = Counter()
"""Hostile inputs generated so far, by kind."""

Snapshot = dict[str, tuple[Any, ...]]


class Ground:
    """A data root inside a directory that nobody may touch, and the commands on it."""

    def __init__(self, guard: Path) -> None:
        self.guard, self.data, self.out = guard, guard / "data", guard / "out"
        self.out.mkdir()
        self.canary = guard / "canary"
        """What hostile code would create."""
        (guard / "outside.txt").write_text("none of a command's business")
        self._truths: dict[tuple[str, ...], str] = {}

    def call(self, *arguments: object, data: object = None, input: str | bytes | None = None) -> Result:
        """The command as it ends; it ends as the contract says."""
        return self.ask(*arguments, "--data", self.data if data is None else data, input=input)

    def ask(self, *arguments: object, input: str | bytes | None = None) -> Result:
        """The same, with every word given."""
        result = CliRunner().invoke(cli, [*map(str, arguments)], input=input)
        judge(result)
        return result

    @property
    def environment(self) -> dict[str, str]:
        """Of a process of its own, which finds this code and this data root."""
        return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "PIPELINE_DATA": str(self.data)}

    def refused(self, *arguments: object, codes: tuple[int, ...] = (3,), **options: Any) -> Result:
        """The command, which must refuse its input."""
        result = self.call(*arguments, **options)
        assert result.exit_code in codes, (result.exit_code, result.output)
        return result

    def not_deceived(self, *arguments: object) -> Result:
        """The command, which refuses its input or answers as if it were whole."""
        result = self.call(*arguments)
        assert result.exit_code != 0 or result.stdout == self._truths[tuple(map(str, arguments))], arguments
        return result

    def learn(self, *arguments: object) -> None:
        """Remember the answer of a command while nothing is damaged."""
        result = self.call(*arguments)
        assert result.exit_code == 0, result.output
        self._truths[tuple(map(str, arguments))] = result.stdout

    @contextmanager
    def case(self, kind: str) -> Iterator[None]:
        """One hostile input, which is in place now: whatever is asked of it, the disk stays as it is."""
        CASES[kind] += 1
        before = self._snapshot()
        yield
        after = self._snapshot()
        changed = {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
        assert not changed, changed
        shutil.rmtree(self.out)
        self.out.mkdir()

    @contextmanager
    def damaged(self, path: Path, damage: Callable[[bytes], bytes]) -> Iterator[None]:
        """A file with other content, until the block ends."""
        whole = path.read_bytes()
        times = path.stat().st_atime_ns, path.stat().st_mtime_ns
        try:
            path.write_bytes(damage(whole))
            yield
        finally:
            path.write_bytes(whole)
            os.utime(path, ns=times)

    @contextmanager
    def edited(self, artifact: str, edit: Callable[[dict[str, Any]], Any]) -> Iterator[None]:
        """A manifest with other fields, until the block ends; its seal, which anybody can make anew, is off."""

        def change(data: bytes) -> bytes:
            fields = json.loads(data) | {"seal": None}
            edit(fields)
            return json.dumps(fields).encode()

        with self.damaged(self.data / artifact / "manifest.json", change):
            yield

    def _snapshot(self) -> Snapshot:
        """Everything below the guard but the commands' own output and their locks."""
        found: Snapshot = {}
        for directory, names, files in os.walk(self.guard):
            if Path(directory) == self.guard:
                names.remove(self.out.name)
            if Path(directory) == self.data and ".locks" in names:
                names.remove(".locks")
            for name in [*names, *files]:
                path = Path(directory, name)
                status = path.lstat()
                inside = () if path.is_dir() else (status.st_size, status.st_mtime_ns)
                found[str(path)] = (status.st_ino, status.st_mode, *inside)
        return found


def judge(result: Result) -> None:
    """A foreseen end: an exit code of the contract, and one short message where it is not 0."""
    said = result.stderr
    assert result.exit_code in CODES, (result.exit_code, said)
    assert "Traceback" not in result.output
    if result.exit_code == 0:
        return
    assert said.startswith("Error: "), said
    assert "unexpected" not in said.split(":", 2)[1], said  # nobody foresaw it: see pipeline/failures.py
    assert len(said) <= LONGEST, said
    assert said.count("\n") == 1 or said.startswith("Error: SQL: "), said  # DuckDB shows the place below its message
    assert all(character.isprintable() or character == "\n" for character in said), repr(said)
