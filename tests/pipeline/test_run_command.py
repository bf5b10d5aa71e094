"""`pipeline run`, dry runs, and looking at what there is."""

from pathlib import Path

import pytest

from tests.pipeline.fakes import TINY, Run, Stages, answer, prepare, refused

DENSE = "runs/default/reach-dense-orbit00-seed0"


def test_run_makes_everything_and_then_nothing(run: Run, stages: Stages, data: Path) -> None:
    first = run("run", "demo", *TINY)
    assert first.exit_code == 0, first.output
    assert list(dict.fromkeys(stages.calls)) == ["collect", "train-perception", "train-policy", "analyze"]
    calls = len(stages.calls)
    assert str(data / "reports" / "demo" / "report.html") in first.stdout
    assert str(data / "reports" / "demo" / "comparison.rrd") in first.stdout
    assert "reach-dense-orbit00-seed0" in first.stdout
    second = answer(run("run", "demo", *TINY, "--json"))
    assert {each["did"] for stage in second["stages"].values() for each in stage} == {"nothing"}
    assert len(stages.calls) == calls


def test_run_does_only_what_is_missing(run: Run, stages: Stages) -> None:
    prepare(run, "collect")
    made = answer(run("run", "--profile", "demo", "--name", "default", *_same_as_defaults(), *TINY, "--json"))
    assert [outcomes[0]["did"] for outcomes in made["stages"].values()] == ["nothing", "made", "made", "made"]


def _same_as_defaults() -> list[str]:
    """The demo's collection settings, back at the defaults that `collect` was called with."""
    return ["--set", "collect.keep_fraction=0.25", "--set", "world.cube_half_range=0.15"]


def test_run_goes_on_after_an_interruption(run: Run, stages: Stages) -> None:
    stages.errors = {"collect": KeyboardInterrupt()}
    stopped = run("run", "demo", *TINY)
    assert stopped.exit_code == 130
    assert "the same command goes on from the last checkpoint" in stopped.stderr
    made = answer(run("run", "demo", *TINY, "--json"))
    assert [outcomes[0]["did"] for outcomes in made["stages"].values()] == ["resumed", "made", "made", "made"]


def test_run_reports_on_failed_runs_too(run: Run, stages: Stages) -> None:
    stages.failing_cells = {"dense": "NaN"}
    result = run("run", "demo", *TINY)
    assert result.exit_code == 4
    assert "1 of 2 runs failed" in result.stderr
    assert "report.html" in result.stdout
    assert len(stages.options["analyze"]["runs"]) == 2


def test_run_needs_one_profile(run: Run, stages: Stages) -> None:
    refused(run("run"), 2, "name a profile, one of: demo, laptop, paper")
    refused(run("run", "huge"), 2, "unknown profile 'huge'; valid: demo, laptop, paper")
    refused(run("run", "demo", "--profile", "laptop"), 2, "two profiles are named")


@pytest.mark.parametrize("command", ["collect", "train-perception", "train-policy", "analyze"])
def test_dry_run_does_nothing(run: Run, stages: Stages, data: Path, command: str) -> None:
    prepare(run, "collect", "train-perception", "train-policy", "analyze")
    before, calls = sorted(data.rglob("*")), len(stages.calls)
    plan = answer(run(command, *TINY, "--dry-run", "--json"))
    assert {step["plan"] for step in plan["plan"]} == {"nothing"}
    assert plan["config"]["collect"]["episodes"] == 2
    assert sorted(data.rglob("*")) == before
    assert len(stages.calls) == calls


def test_dry_run_of_run_knows_what_waits_for_what(run: Run, stages: Stages, data: Path) -> None:
    plan = answer(run("run", "demo", *TINY, "--dry-run", "--json"))["plan"]
    later = "make, once its inputs are there"
    assert [step["plan"] for step in plan] == ["make", later, later, later, later]
    assert plan[2]["id"] == "runs/demo/reach-dense-orbit00-seed0"
    assert not data.exists()


def test_dry_run_prints_config_and_plan(run: Run, stages: Stages) -> None:
    printed = run("collect", *TINY, "--dry-run").stdout
    assert "[collect]\n" in printed
    assert "  episodes = 2\n" in printed
    assert "datasets/default: make" in printed


def test_dry_run_refuses_what_the_command_would(run: Run, stages: Stages) -> None:
    prepare(run, "collect")
    refused(run("collect", "--dry-run"), 2, "collect.episodes: 2 → 1600")


def test_list(run: Run, stages: Stages, data: Path) -> None:
    assert "nothing under" in run("list").stderr
    prepare(run, "collect", "train-perception")
    listed = answer(run("list", "--json"))["artifacts"]
    assert [(each["id"], each["status"]) for each in listed] == [
        ("datasets/default", "complete"),
        ("estimators/default", "complete"),
    ]
    assert "test_mean_error 0.014" in run("list", "estimators").stdout
    assert "datasets/default" not in run("list", "estimators").stdout


def test_a_damaged_artifact_does_not_hide_the_others(run: Run, stages: Stages, data: Path) -> None:
    prepare(run, "collect", "train-perception")
    (data / "datasets" / "default" / "manifest.json").write_text("{")
    listed = answer(run("list", "--json"))["artifacts"]
    assert [each["status"] for each in listed] == ["damaged", "complete"]


def test_an_interrupted_artifact_is_listed_as_such(run: Run, stages: Stages) -> None:
    stages.errors = {"collect": KeyboardInterrupt()}
    run("collect", *TINY)
    assert "interrupted" in run("list").stdout
    assert answer(run("list", "--json"))["artifacts"][0]["status"] == "running"


def test_show(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    shown = answer(run("show", DENSE, "--json"))
    assert (shown["id"], shown["status"]) == (DENSE, "complete")
    first = shown["lineage"]["inputs"][0]
    assert (first["id"], first["inputs"][0]["id"]) == ("estimators/default", "datasets/default")
    printed = run("show", DENSE).stdout
    assert printed.index(DENSE) < printed.index("estimators/default") < printed.index("datasets/default")
    refused(run("show", "default"), 2, "ambiguous")
    refused(run("show", "datasets/none"), 3, "datasets/none does not exist")
