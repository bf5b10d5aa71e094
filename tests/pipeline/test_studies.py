"""Studies: what a configuration may say of them, which runs they are, and which of them a report answers."""

from pathlib import Path
from typing import Any

import pytest

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.store import Store
from pipeline.config import PipelineConfig, Variant, load_config, variants
from pipeline.matrix import cells
from pipeline.steps.studies import chosen
from pipeline.studies import logged_keys
from schemas.errors import ConfigError
from stages.analyze.studies import Study
from tests.pipeline.fakes import Run, Stages, answer, refused

SWITCH = """
[studies.switch]
question = "When should the reward switch?"
[studies.switch.set]
"policy.schemes" = ["dense2sparse"]
[studies.switch.vary]
"policy.switch_episode" = [2, 4]
"""
TOUCH = """
[studies.touch]
question = "What counts as touch?"
vary = { "world.touch" = ["fingers", "hand"] }
"""
MAIN = """
[collect]
episodes = 2
steps = 4
[policy]
schemes = ["dense"]
"""
EARLY, LATE = (f"runs/default-switch-{episode}/reach-dense2sparse-orbit00-seed0" for episode in (2, 4))


@pytest.fixture
def written(tmp_path: Path) -> Any:
    """Writes a configuration file."""

    def write(*texts: str) -> Path:
        path = tmp_path / "config.toml"
        path.write_text("".join(texts))
        return path

    return write


@pytest.fixture
def wrong(written: Any) -> Any:
    """The message about a configuration that is refused."""

    def load(*texts: str) -> str:
        with pytest.raises(ConfigError) as caught:
            load_config(file=written(*texts))
        return str(caught.value)

    return load


def vary(text: str, changed: str = "", name: str = "x") -> str:
    return f'[studies.{name}]\nquestion = "?"\n[studies.{name}.set]\n{changed}\n[studies.{name}.vary]\n{text}\n'


def suffixes(config: PipelineConfig, name: str = "x") -> list[str]:
    return [variant.suffix for variant in variants(config, name)]


def test_a_variant_is_the_configuration_with_the_study_laid_over_it(written: Any) -> None:
    config = load_config(file=written(MAIN, SWITCH), overrides=["policy.episodes=9"])
    early, late = variants(config, "switch")
    assert [early.run("laptop"), late.run("laptop")] == ["laptop-switch-2", "laptop-switch-4"]
    assert (early.config.policy.switch_episode, late.config.policy.switch_episode) == (2, 4)
    assert early.config.policy.schemes == ("dense2sparse",)
    assert (early.config.policy.episodes, early.config.collect, early.config.studies) == (9, config.collect, {})


def test_variants_are_every_combination_in_order(written: Any) -> None:
    config = load_config(file=written(vary('"policy.buffer" = ["keep", "relabel"]\n"policy.reset" = ["none", "all"]')))
    assert suffixes(config) == ["x-keep-all", "x-relabel-none", "x-relabel-all"], "keep, none: the matrix has it"


def test_a_combination_is_left_out_only_if_the_matrix_learns_the_same(written: Any) -> None:
    buffers = '"policy.buffer" = ["keep", "empty"]'
    assert suffixes(load_config(file=written(vary(buffers, '"policy.final_episodes" = 5')))) == ["x-empty"]
    longer = load_config(file=written(vary(buffers, '"policy.episodes" = 5')))
    elsewhere = load_config(file=written(vary(buffers, '"policy.seeds" = [0, 7]')))
    assert suffixes(longer) == suffixes(elsewhere) == ["x-keep", "x-empty"]


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ('"policy.td3.gamma" = [0.9, 0.97]', ["x-0.97"]),
        ('"policy.td3.learning_rate" = [1e-5]', ["x-1e-05"]),
        ('"policy.td3.hidden" = [[8, 8], [16, 16]]', ["x-8_8", "x-16_16"]),
        ("policy.switch_episode = [1]", ["x-1"]),
    ],
)
def test_values_in_names(written: Any, values: str, names: list[str]) -> None:
    assert suffixes(load_config(file=written(vary(values)))) == names


def test_an_override_reaches_into_a_study(written: Any) -> None:
    config = load_config(file=written(SWITCH), overrides=["studies.switch.vary.policy.switch_episode=[7]"])
    assert suffixes(config, "switch") == ["switch-7"]


OF_LIFT = "[policy]\ntasks = ['reach', 'lift']\n[policy.lift.td3]\ngamma = 0.97\n"


def test_a_tasks_own_value_is_not_passed_over(written: Any, wrong: Any) -> None:
    gamma = '"policy.td3.gamma" = [0.8, 0.9]'
    assert "studies.x: policy.td3.gamma is not heard by lift" in wrong(OF_LIFT, vary(gamma))
    assert load_config(file=written(OF_LIFT, vary(gamma, '"policy.tasks" = ["reach"]')))
    assert load_config(file=written(OF_LIFT, vary(gamma, '"policy.lift.td3.gamma" = 0.99')))
    lift = variants(load_config(file=written(OF_LIFT, vary('"policy.lift.td3.gamma" = [0.8, 0.9]'))), "x")
    assert [{cell.config.td3.gamma for cell in cells(each.config.policy)} for each in lift] == [{0.9, 0.8}, {0.9}]


@pytest.mark.parametrize(
    ("study", "message"),
    [
        (vary('"policy.swich_episode" = [1]'), "studies.x: unknown key policy.swich_episode (did you mean switch_epis"),
        (vary('"policy.episodes" = [0]'), "studies.x: policy.episodes = 0 is out of range; allowed: >= 1"),
        (vary('"policy.episodes" = [1]', '"world.touch" = "toe"'), "world.touch = 'toe' is not one of:"),
        (vary('"policy.episodes.x" = [1]', '"policy.episodes" = 3'), "studies.x: policy.episodes is a value, not a se"),
        (vary('"collect.episodes" = [1]'), "'collect.episodes' cannot be changed: a study trains other runs with"),
        (vary('"policy.episodes" = [1]', '"policy.episodes" = 3'), "policy.episodes is both in set and in vary"),
        (vary('"policy.seeds" = [[1, 1]]'), "studies.x: the matrix of [policy] holds"),
        (vary('"policy.workers" = [1, 2]'), "studies.x: the matrix of [policy] has all of its runs already"),
        (vary('"policy.buffer" = ["ke ep"]'), "no run can be named by 'x-ke ep'"),
        (vary('"policy.episodes" = [1]', name="all"), "no study can be named 'all'"),
        (vary('"policy.episodes" = [1]', name='"a b"'), "no study can be named 'a b'"),
        (vary('"policy.episodes" = [1, 1]'), "x-1 and x-1 are the same runs"),
        (vary(""), "studies.x.vary = {}"),
        (vary('"policy.episodes" = []'), "studies.x.vary.policy.episodes = []"),
        (vary('"policy.episodes" = 3'), "studies.x.vary.policy.episodes = 3: should be a valid list"),
        ("[studies.x]\nvary = 3\n", "studies.x.question is missing; studies.x.vary = 3 is not a section"),
        (vary('"policy.episodes" = [1]') + "[studies.x.sets]", "unknown key studies.x.sets (did you mean set?); valid"),
    ],
)
def test_a_wrong_study_shows_when_the_configuration_is_read(wrong: Any, study: str, message: str) -> None:
    assert message in wrong(study)


def test_two_variants_of_one_name_are_refused(wrong: Any) -> None:
    one = vary('"policy.buffer" = ["keep"]\n"policy.episodes" = [3]')
    two = vary('"policy.episodes" = [3]', name="x-keep")
    assert "2 variants of the studies have the name NAME-x-keep-3" in wrong(one, two)


def test_a_name_that_becomes_too_long_is_refused(written: Any) -> None:
    with pytest.raises(ConfigError, match="at most 100 characters"):
        variants(load_config(file=written(SWITCH)), "switch")[0].run("n" * 99)


def test_keys_as_the_runs_have_them() -> None:
    lift = "policy.tasks=['lift']"
    config = load_config(overrides=[lift, "studies.x.question=why", "studies.x.vary.policy.lift.td3.gamma=[0.8]"])
    assert logged_keys(config.studies["x"], ("reach", "lift")) == ("policy.td3.gamma",)
    config = load_config(overrides=["studies.x.question=why", "studies.x.vary.policy.misalignment_kind=['pan']"])
    assert logged_keys(config.studies["x"], ("reach", "lift")) == ("run.misalignment_kind",)


def test_choosing_studies(written: Any) -> None:
    config = load_config(file=written(SWITCH, TOUCH))
    assert _names(chosen(config, [])) == []
    assert _names(chosen(config, ["touch", "touch"])) == ["touch-hand"]
    assert _names(chosen(config, ["all"])) == ["switch-2", "switch-4", "touch-hand"]


def _names(found: list[Variant]) -> list[str]:
    return [variant.suffix for variant in found]


def test_an_unknown_study_is_refused(run: Run, stages: Stages, written: Any) -> None:
    config = written(MAIN, SWITCH)
    refused(run("run", "--config", config, "--study", "swich"), 2, "unknown study 'swich'; valid: all, switch")
    refused(run("run", "demo", "--study", "all", "--set", "studies={}"), 2, "not of the form")
    refused(run("run", "--config", written(MAIN), "--study", "all"), 2, "this configuration has no section [studies.")
    assert stages.calls == []


def test_run_trains_a_study_after_the_matrix(run: Run, stages: Stages, store: Store, written: Any) -> None:
    config = written(MAIN, SWITCH)
    made = answer(run("run", "--config", config, "--study", "switch", "--json"))
    trained = [cell["id"] for cell in made["stages"]["train-policy"]]
    assert trained == ["runs/default/reach-dense-orbit00-seed0", EARLY, LATE]
    main, beside = stages.calls_of("train-policy")
    assert main["estimator"] == beside["estimator"] == store.path("estimators/default")
    assert [spec.config.switch_episode for spec in beside["specs"]] == [2, 4], "all variants in one go"
    assert [spec.run_id.split("/")[0] for spec in beside["specs"]] == ["default-switch-2", "default-switch-4"]
    [report] = stages.calls_of("analyze")
    assert report["runs"] == ["default/reach-dense-orbit00-seed0"]
    runs = ("default-switch-2", "default-switch-4")
    keys = ("policy.switch_episode",)
    assert report["studies"] == [Study("switch", "When should the reward switch?", keys, runs, "default")]
    manifest = load_complete(store.root, "reports/default")
    assert [ref.id for ref in manifest.inputs][-2:] == [EARLY, LATE]
    again = answer(run("run", "--config", config, "--study", "all", "--json"))
    assert {each["did"] for stage in again["stages"].values() for each in stage} == {"nothing"}


def test_without_study_the_main_matrix_only(run: Run, stages: Stages, store: Store, written: Any) -> None:
    config = written(MAIN, SWITCH)
    shown = run("run", "--config", config)
    assert (shown.exit_code, "4/4 analyze" in shown.stderr, "switch" in shown.output) == (0, True, False)
    assert "studies" not in load_complete(store.root, "reports/default").config
    assert stages.options["analyze"]["studies"] == []


def test_studies_are_no_part_of_other_artifacts(run: Run, stages: Stages, written: Any) -> None:
    answer(run("run", "--config", written(MAIN), "--json"))
    again = answer(run("run", "--config", written(MAIN, SWITCH), "--json"))
    assert {each["did"] for stage in again["stages"].values() for each in stage} == {"nothing"}


def test_dry_run_plans_the_studies(run: Run, stages: Stages, written: Any) -> None:
    config = written(MAIN, SWITCH, TOUCH)
    asked = ("run", "--config", config, "--study", "switch", "--dry-run", "--json")
    answer(run("run", "--config", config, "--json"))
    planned = {step["id"]: step["plan"] for step in answer(run(*asked))["plan"]}
    assert planned == {
        "datasets/default": "nothing",
        "estimators/default": "nothing",
        "runs/default/reach-dense-orbit00-seed0": "nothing",
        EARLY: "make",
        LATE: "make",
        "reports/default": "make, once its inputs are there",
    }


def test_a_report_is_made_anew_when_a_study_has_more_runs_or_another_question(
    run: Run, stages: Stages, store: Store, written: Any
) -> None:
    answer(run("run", "--config", written(MAIN, SWITCH), "--json"))
    asked = ("analyze", "--runs", "default", "--json", "--config")
    assert answer(run(*asked, written(MAIN, SWITCH)))["did"] == "nothing"
    answer(run("run", "--config", written(MAIN, SWITCH), "--study", "switch", "--name", "default", "--json"))
    assert answer(run(*asked, written(MAIN, SWITCH)))["did"] == "nothing", "run has made it anew"
    other = SWITCH.replace("When should", "Why does")
    plan = answer(run(*asked, written(MAIN, other), "--dry-run"))["plan"]
    assert plan == [{"id": "reports/default", "plan": "make again: new inputs"}]
    assert answer(run(*asked, written(MAIN, other)))["did"] == "made"
    assert load_complete(store.root, "reports/default").config["studies"][0]["question"].startswith("Why does")
    assert answer(run(*asked, written(MAIN)))["did"] == "made", "without its studies it is another report"
    assert stages.options["analyze"]["studies"] == []


def test_an_unfinished_variant_is_left_out_and_named(run: Run, stages: Stages, written: Any) -> None:
    config = written(MAIN, SWITCH)
    answer(run("run", "--config", config, "--study", "switch", "--json"))
    more = ("--config", config, "--set", "policy.seeds=[0, 1]")
    shown = run("analyze", "--runs", "default", *more)
    assert "runs/default-switch-2: 1 of 2 runs are not finished: the variant is left out" in shown.stderr
    assert stages.options["analyze"]["studies"] == []
    stages.calls.clear()
    made = answer(run("run", *more, "--json"))
    left_out = {"id": "runs/default-switch-2", "unfinished": 1, "of": 2, "left_out": 2}
    assert left_out in made["left_out"]
    plan = answer(run("run", *more, "--dry-run", "--json"))["plan"]
    assert {"runs/default-switch-2", "runs/default-switch-4"} <= {step["id"] for step in plan}


def test_a_failed_variant_is_reported_on(run: Run, stages: Stages, written: Any) -> None:
    stages.failing_cells = {"dense2sparse": "NaN"}
    result = run("run", "--config", written(MAIN, SWITCH), "--study", "switch")
    assert result.exit_code == 4
    assert "2 of 3 runs failed" in result.stderr
    assert stages.options["analyze"]["studies"][0].runs == ("default-switch-2", "default-switch-4")


def test_an_interrupted_study_goes_on(run: Run, stages: Stages, written: Any) -> None:
    config = written(MAIN, SWITCH)
    answer(run("run", "--config", config, "--json"))
    stages.errors = {"train-policy": KeyboardInterrupt()}
    assert run("run", "--config", config, "--study", "switch").exit_code == 130
    made = answer(run("run", "--config", config, "--study", "switch", "--json"))["stages"]["train-policy"]
    assert [cell["did"] for cell in made] == ["nothing", "resumed", "resumed"]


def test_a_taken_name_shows_before_anything_is_trained(run: Run, stages: Stages, written: Any) -> None:
    answer(run("run", "--config", written(MAIN, SWITCH), "--study", "switch", "--json"))
    stages.calls.clear()
    longer = ("--set", "policy.schemes=['sparse']", "--set", "studies.switch.set.policy.episodes=9")
    refused(run("run", "--config", written(MAIN, SWITCH), "--study", "switch", "--quiet", *longer), 2, "300 → 9")
    assert "train-policy" not in stages.calls


def test_a_study_of_another_robot_needs_another_estimator(run: Run, stages: Stages, written: Any) -> None:
    config = written(MAIN, vary('"world.robot" = ["Sawyer"]'))
    refused(run("run", "--config", config, "--study", "x", "--quiet"), 2, "learned from images of Panda")
