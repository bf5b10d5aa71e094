"""What holds for every command: help with an example, lazy imports, one way of failing."""

import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from pipeline.cli import COMMANDS, cli

ROOT = Path(__file__).parents[2]
HEAVY = {"torch", "robosuite", "mujoco", "pyarrow", "polars", "duckdb", "rerun", "numpy", "pydantic", "rich", "altair"}
COMMON = {"--data", "--json", "--quiet", "--debug"}
STAGE = {"--config", "--profile", "--set", "--name", "--dry-run", "--resume"} | COMMON

NAMES = pytest.mark.parametrize("name", list(COMMANDS))


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout


def command(name: str) -> click.Command:
    found = cli.get_command(click.Context(cli), name)
    assert found is not None
    return found


@pytest.mark.parametrize("arguments", [["--help"], *([name, "--help"] for name in COMMANDS)])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom pipeline.cli import cli\n"
        f"try:\n    cli.main({arguments!r})\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "print('MODULES', *sorted({name.partition('.')[0] for name in sys.modules}))"
    )
    loaded = set(python(code).rpartition("MODULES")[2].split())
    assert not loaded & HEAVY


@NAMES
def test_every_command_has_help_and_an_example(name: str) -> None:
    shown = CliRunner().invoke(cli, [name, "--help"]).output
    assert COMMANDS[name].summary in " ".join(shown.split())
    assert "Example:" in shown
    assert re.search(rf"^ +pipeline {name}\b", shown, re.MULTILINE)


@NAMES
def test_every_command_has_the_common_options(name: str) -> None:
    options = {option for parameter in command(name).params for option in parameter.opts}
    stages = ("collect", "train-perception", "train-policy", "analyze", "run")
    assert (STAGE if name in stages else COMMON) <= options


@NAMES
def test_examples_parse(name: str) -> None:
    epilog = command(name).epilog or ""
    examples = re.findall(rf"^  pipeline {name}\b(.*)$", epilog, re.MULTILINE)
    assert examples
    for example in examples:
        command(name).make_context(name, shlex.split(example))


def test_group_help_lists_every_command() -> None:
    shown = CliRunner().invoke(cli, ["--help"]).output
    for name in COMMANDS:
        assert re.search(rf"^  {name} ", shown, re.MULTILINE)


def test_version() -> None:
    assert CliRunner().invoke(cli, ["--version"]).output == "pipeline, version 0.1.0\n"


def test_no_command_shows_the_help() -> None:
    done = subprocess.run([sys.executable, "-m", "pipeline"], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: ") and done.stdout.count("Usage:") == 1


def test_interrupted_sql(tmp_path: Path) -> None:
    question = "SELECT sum(i * j) FROM range(1000000) a(i), range(1000000) b(j)"  # takes hours
    command = [sys.executable, "-m", "pipeline", "sql", question, "--data", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    time.sleep(3)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=20)
    assert (process.returncode, stdout, stderr.strip()) == (130, "", "Error: interrupted")


def test_python_dash_m() -> None:
    done = subprocess.run([sys.executable, "-m", "pipeline", "nope"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr.startswith("Error: unknown command 'nope'; valid: collect")


def test_data_root_from_the_environment(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["list"], env={"PIPELINE_DATA": str(tmp_path / "elsewhere")})
    assert str(tmp_path / "elsewhere") in result.stderr


STOP_ME = """
import sys, time, types
import stages.sim.gl
stages.sim.gl.gl_renderer = lambda: "test"
asks = sys.argv[2] == "asks"
def run(config, out, progress, **options):
    (out / "half").write_text("half")
    print("started", flush=True)
    while not (asks and progress.stopping()):
        time.sleep(0.05)
    raise KeyboardInterrupt
sys.modules["stages.collect.run"] = types.SimpleNamespace(run=run)
from pipeline.cli import main
sys.argv = ["pipeline", "collect", "--data", sys.argv[1]]
main()
"""


@pytest.mark.parametrize(
    ("stage", "how"),
    [
        ("asks", [signal.SIGINT]),
        ("asks", [signal.SIGTERM]),
        ("never asks", [signal.SIGINT, signal.SIGINT]),
        ("never asks", [signal.SIGTERM, signal.SIGINT]),
    ],
)
def test_interruption(tmp_path: Path, stage: str, how: list[signal.Signals]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", STOP_ME, str(tmp_path), stage],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    for number in how:
        time.sleep(0.2)
        process.send_signal(number)
    _, stderr = process.communicate(timeout=20)
    assert process.returncode == 130
    assert [line for line in stderr.splitlines() if line] == [
        "stopping at the next whole episode or epoch, which is kept (Ctrl-C again: now)",
        "Error: interrupted; the same command with --resume goes on from the last checkpoint",
    ]
    assert '"status": "running"' in (tmp_path / "datasets/default/manifest.json").read_text()
