"""The house rules that can be checked by machine: imports go one way, the lock holds what is declared."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = dict(line.split("==") for line in (ROOT / "requirements.lock").read_text().split())


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_import_contracts_hold() -> None:
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stdout
    assert "0 broken" in done.stdout


def test_lock_is_names_and_versions_only() -> None:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line) for line in lines)
    assert lines == sorted(set(lines))
    assert LOCK["torch"] == "2.13.0"


@pytest.mark.parametrize("text", [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]])
def test_lock_holds_every_dependency_in_its_range(text: str) -> None:
    requirement = Requirement(text)
    assert requirement.specifier.contains(LOCK[normalised(requirement.name)])


def test_lock_leaves_out_what_needs_a_compiler() -> None:
    assert not {"pynput", "evdev", "python-xlib", "mink", "opencv-python"} & set(LOCK)
    assert not [name for name in LOCK if name.startswith("nvidia")]


def test_this_environment_is_the_locked_one() -> None:
    found = {}
    for name in LOCK:
        try:
            found[name] = version(name).partition("+")[0]
        except PackageNotFoundError:
            found[name] = "missing"
    assert found == LOCK
