"""Names that are paths, options, markup, code or nothing: as arguments, and of directories that lie there."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from tests.analyze.fake_runs import write_run
from tests.hostile.cases import ODD_NAMES, cases, odd_names
from tests.hostile.ground import Ground
from tests.hostile.stock import DATASET, ESTIMATOR, LEARNT, edit_manifest

ASKED = (
    ("collect", "--dry-run", "--name"),
    ("train-perception", "--dry-run", "--dataset"),
    ("train-policy", "--dry-run", "--name", "n", "--estimator"),
    ("train-policy", "--dry-run", "--estimator", "resnet", "--name"),
    ("train-policy", "--dry-run", "--offline"),
    ("collect", "--dry-run", "--policy"),
    ("analyze", "--dry-run", "--runs"),
    ("analyze", "--dry-run", "--estimators"),
    ("analyze", "--dry-run", "--name"),
    ("run", "demo", "--dry-run", "--study"),
    ("relabel", LEARNT, "--scheme", "sparse", "--estimator"),
    ("list",),
    ("show",),
    ("verify",),
    ("compare",),
    ("view", "--save", "out/x.rrd"),
    ("replay", "--episode", "0"),
    ("export", "--format", "minari", "-o", "out/x"),
    ("repair",),
    ("collect", "--dry-run", "--profile"),
    ("collect", "--dry-run", "--config"),
    ("collect", "--dry-run", "--set"),
    ("sql", "--schema"),
)
"""What takes a name as the last word."""


def _takes(arguments: tuple[str, ...]) -> bool:
    """The name is an option's value; else it stands alone, after `--`."""
    return arguments[-1].startswith("--") and arguments[-1] != "--schema"


@cases(50, 500)
@given(st.sampled_from(ASKED), odd_names)
@example(("show",), "a\nb")
@example(("train-policy", "--dry-run", "--offline"), "")
def test_names_that_are_asked_for(ground: Ground, arguments: tuple[str, ...], name: str) -> None:
    given_name = [f"{arguments[-1]}={name}"] if _takes(arguments) else ["--", name]
    place = ["--data", str(ground.data)]
    with ground.case("names"):
        first = arguments[:-1] if _takes(arguments) else arguments
        result = ground.ask(*first, *place, *given_name)
        assert result.exit_code != 4, result.stderr


def test_every_odd_name_is_refused_as_a_new_artifacts(ground: Ground) -> None:
    for name in (name for name in ODD_NAMES if name and name not in ("NUL", "con.")):
        with ground.case("new names"):
            ground.refused("collect", "--dry-run", f"--name={name}", codes=(2,))
            ground.refused("relabel", LEARNT, "--scheme", "oracle", f"--name={name}", codes=(2,))


_directory_names = odd_names.filter(
    lambda name: name not in ("", ".", "..") and "/" not in name and len(name.encode()) < 250
)


@cases(2, 100)
@given(_directory_names, st.sampled_from(["datasets", "estimators", "runs"]), st.booleans())
@example("[/]", "runs", False)  # once an unexpected MarkupError
@example("'; DROP TABLE runs; --", "runs", False)
@example("<script>alert(1)</script>", "estimators", False)
@example("\x1b]0;owned\x07", "datasets", True)
@example("{a,b}*?[c]", "runs", False)
def test_names_that_lie_there(ground: Ground, name: str, kind: str, admits_it: bool) -> None:
    """A copy made by hand under such a name, whose manifest has it too or not."""
    source = {"datasets": DATASET, "estimators": ESTIMATOR, "runs": LEARNT}[kind]
    copy = ground.data / kind / name
    cell = copy / name if kind == "runs" else copy
    shutil.copytree(ground.data / source, cell)
    artifact = cell.relative_to(ground.data).as_posix()
    if admits_it:
        edit_manifest(cell, id=artifact, name=artifact.partition("/")[2])
    try:
        with ground.case("names on disk"):
            for command in (("list",), ("list", "--json"), ("show", artifact), ("show", artifact, "--json")):
                ground.call(*command)
            ground.call("verify")
            ground.call("sql", f"FROM {kind}")
            ground.call("sql", "SELECT count(*) FROM transitions")
            ground.call("compare", "study")
            ground.call("compare", f"{name}/{name}")
            ground.call("analyze", "--dry-run")
            ground.call("train-policy", "--dry-run", "--estimator", "nobody")
    finally:
        shutil.rmtree(copy)


@cases(2, 80)
@given(_directory_names)
@example("it's")
@example("*?[]{}")
@example("[/]")  # once an unexpected MarkupError
def test_data_roots(ground: Ground, name: str) -> None:
    assume(not name.startswith("~"))
    root = ground.guard / "roots" / name
    write_run(root, episodes=20, switch=10, logged_steps=200)
    try:
        with ground.case("data roots"):
            for command in (("list",), ("verify",), ("compare", "study"), ("sql", "FROM runs")):
                assert ground.call(*command, data=root).exit_code == 0
            assert "200" in ground.call("sql", "SELECT count(*) FROM transitions", data=root).stdout
            ground.call("collect", "--dry-run", data=root)
    finally:
        shutil.rmtree(root.parent)


@pytest.fixture
def odd_root(ground: Ground) -> Iterator[Path]:
    made = ground.guard / "roots"
    made.mkdir()
    (made / "a file").write_text("")
    (made / "a dangling link").symlink_to(made / "nowhere")
    (made / "a link in a circle").symlink_to(made / "a link in a circle")
    yield made
    shutil.rmtree(made)


@pytest.mark.parametrize("name", ["a file", "a dangling link", "a link in a circle", "a file/below", "x" * 300])
@pytest.mark.parametrize(
    "command",
    [
        *(("list",), ("show", "x"), ("verify",), ("sql", "FROM runs"), ("compare", "x"), ("analyze",)),
        *(("collect", "--name", "x"), ("train-policy", "--name", "x"), ("view", "runs/x/y", "--save", "out/x.rrd")),
    ],
    ids=lambda command: command[0],
)
def test_roots_that_are_none(ground: Ground, odd_root: Path, name: str, command: tuple[str, ...]) -> None:
    with ground.case("no data roots"):
        ground.refused(*command, data=odd_root / name, codes=(2,))


@pytest.mark.parametrize("name", [b"\xff\xfe", b"$(touch canary)", "‮".encode()])
@pytest.mark.parametrize("command", [("show",), ("collect", "--dry-run", "--name"), ("list", "--data")])
def test_as_a_process(ground: Ground, command: tuple[str, ...], name: bytes) -> None:
    """Bytes that are no text, as only a real command line can pass them."""
    with ground.case("names in a process"):
        arguments = [sys.executable, "-m", "pipeline", *command, name]
        done = subprocess.run(arguments, capture_output=True, cwd=ground.guard, env=ground.environment)
        assert done.returncode in (0, 2, 3), done.stderr
        assert done.returncode == 0 or done.stderr.startswith(b"Error: ")
        assert done.returncode == 0 or done.stderr.count(b"\n") == 1
        assert b"unexpected" not in done.stderr
