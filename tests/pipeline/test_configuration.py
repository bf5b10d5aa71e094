"""What a configuration may say, and what is said when it says something else."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config import PipelineConfig, load_config, profiles
from pipeline.matrix import cell_name, cells
from pipeline.overrides import apply_override
from schemas.errors import ConfigError


def wrong(*overrides: str, **source: object) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=overrides, **source)
    return str(caught.value)


def test_defaults_when_nothing_is_given() -> None:
    assert load_config() == PipelineConfig()


def test_file_then_override(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[policy]\nepisodes = 7\nseeds = [3]\n[policy.lift.td3]\ngamma = 0.97\n")
    config = load_config(file=path, overrides=["policy.episodes=8", "policy.td3.tau=0.01", "policy.buffer=relabel"])
    assert (config.policy.episodes, config.policy.seeds, config.policy.td3.tau) == (8, (3,), 0.01)
    assert config.policy.buffer == "relabel"
    assert config.policy.for_task("lift").td3.gamma == 0.97
    assert config.policy.for_task("reach").td3.gamma == 0.9


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("policy.episodes=12", 12),
        ("policy.episodes = 12", 12),
        ("policy.episodes=relabel", "relabel"),
        ("policy.episodes='two words'", "two words"),
        ("policy.episodes=[0, 5]", [0, 5]),
        ("policy.episodes=true", True),
        ("policy.episodes=1e-3", 1e-3),
    ],
)
def test_override_is_a_toml_literal_or_a_bare_word(override: str, value: object) -> None:
    values: dict[str, dict[str, object]] = {"policy": {"episodes": 1, "seeds": [0]}}
    apply_override(values, override)
    assert values == {"policy": {"episodes": value, "seeds": [0]}}


@given(st.integers(min_value=1, max_value=10**6))
def test_any_integer_in_range_survives(number: int) -> None:
    assert load_config(overrides=[f"policy.episodes={number}"]).policy.episodes == number


@given(st.text(max_size=20))
def test_any_other_text_is_a_config_error_or_a_value(text: str) -> None:
    try:
        apply_override({}, f"policy.episodes={text}")
    except ConfigError as error:
        assert "policy.episodes" in str(error)


def test_unknown_section_lists_the_sections() -> None:
    sections = "analyze, camera, collect, perception, policy, studies, world"
    assert wrong("foo.bar=1") == f"unknown section foo; valid: {sections}"


def test_unknown_key_lists_the_keys_and_guesses() -> None:
    message = wrong("camera.fovx=1")
    assert message == "unknown key camera.fovx (did you mean fovy?); valid: fovy, image_size, position, target"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("policy.td3.gama=1", "unknown key policy.td3.gama (did you mean gamma?)"),
        ("policy.lift.td3.gama=1", "unknown key policy.lift.td3.gama (did you mean gamma?)"),
        ("policy.lift.foo=1", "unknown key policy.lift.foo;"),
        ("policy.reach.tasks=1", "unknown key policy.reach.tasks:"),
        ("policy.lift.td3=1", "policy.lift.td3 = 1 is not a section"),
        ("policy.lift.observation_scale=[1]", "policy.lift.observation_scale = [1] is not a section"),
        ("policy.td3=1", "policy.td3 = 1 is not a section"),
        ("policy.episodes=0", "policy.episodes = 0 is out of range; allowed: >= 1"),
        ("policy.lift.episodes=0", "policy.lift.episodes = 0 is out of range; allowed: >= 1"),
        ("policy.td3.gamma=1.0", "policy.td3.gamma = 1.0 is out of range; allowed: >= 0 and < 1"),
        (
            "policy.observation_scale.cube=1e-50",
            "policy.observation_scale.cube = 1e-50 is out of range; allowed: >= 1e-06",
        ),
        ("camera.fovy=nan", "camera.fovy = nan is out of range; allowed: > 5 and < 120"),
        ("policy.misalignment_degrees=[0, 91]", "policy.misalignment_degrees[1] = 91 is out of range; allowed: >= 0"),
        ("policy.schemes=['dens']", "policy.schemes[0] = 'dens' is not one of: dense, sparse, oracle, dense2sparse"),
        ("world.robot=SCR5", "world.robot = 'SCR5' is not one of: Panda, Sawyer, IIWA, Kinova3"),
        ("policy.seeds=3", "policy.seeds = 3: should be a list"),
        ("policy.episodes=many", "policy.episodes = 'many': should be a valid integer"),
        ("camera.position=[1, 2]", "camera.position[2] is missing"),
        ("collect.test_fraction=0.95", "collect: validation_fraction + test_fraction must be below 1"),
        (
            "policy.reset_updates=5",
            "reset_updates = 5 is for new critics that learn from an old buffer: it takes reset =",
        ),
        ("policy.episodes.x=1", "policy.episodes"),
        ("policy=1", "--set 'policy=1' is not of the form section.key=value"),
        ("policy.episodes", "--set 'policy.episodes' is not of the form section.key=value"),
        ("policy.seeds=[1", "--set 'policy.seeds=[1': the value is no TOML literal"),
        ("policy.episodes=1\nseed=2", "one value only"),
    ],
)
def test_errors_name_the_key_the_value_and_what_is_allowed(override: str, message: str) -> None:
    assert message in wrong(override)


def test_errors_of_several_keys_are_cut_short() -> None:
    message = wrong(*(f"policy.{key}=-1" for key in ("episodes", "eval_every", "eval_episodes", "workers")))
    assert message.count("out of range") == 3
    assert message.endswith("(and 1 more)")


def test_unknown_profile_lists_the_profiles() -> None:
    assert wrong(profile="huge") == "unknown profile 'huge'; valid: demo, laptop, paper"


def test_profile_and_file_exclude_each_other(tmp_path: Path) -> None:
    assert "exclude each other" in wrong(profile="demo", file=tmp_path / "c.toml")


def test_missing_and_broken_files(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    assert wrong(file=path) == f"cannot read the config {path}: No such file or directory"
    path.write_text("[policy\n")
    assert wrong(file=path).startswith(f"{path} is no TOML: ")


@pytest.mark.parametrize("profile", ["demo", "laptop", "paper"])
def test_profiles_are_valid(profile: str) -> None:
    assert load_config(profile)
    assert profiles() == ["demo", "laptop", "paper"]


def test_paper_profile_has_the_papers_numbers() -> None:
    config = load_config("paper")
    collect, policy = config.collect, config.policy
    assert (collect.episodes, collect.steps, collect.keep_fraction, collect.random_fraction) == (1600, 200, 0.25, 0.4)
    assert collect.episodes * collect.steps * collect.keep_fraction == 80_000
    assert config.perception.epochs == 500
    assert config.world.horizon == 200
    assert config.camera.image_size == 128
    for task, degrees in (("reach", (0.0, 5.0, 10.0)), ("lift", (0.0,))):
        matrix = policy.for_task(task)
        assert matrix.td3.gamma == 0.9
        assert matrix.misalignment_degrees == degrees
        assert (matrix.eval_every, matrix.eval_episodes, matrix.final_episodes) == (20, 5, 1000)
        assert len(matrix.schemes) == 4
        assert len(matrix.seeds) == 3
    assert len(cells(policy)) == 36 + 12


def test_laptop_profile_learns_with_what_was_measured_to_work() -> None:
    policy = load_config("laptop").policy
    reach, lift = (policy.for_task(task).td3 for task in ("reach", "lift"))
    assert (reach.gamma, reach.exploration_noise) == (0.97, 0.2)
    assert (lift.gamma, lift.exploration_noise) == (0.97, 0.3)
    assert policy.final_episodes == 200
    assert len(cells(policy)) == 36 + 12


def test_every_number_of_the_paper_names_its_section() -> None:
    lines = (Path(__file__).parents[2] / "pipeline/profiles/paper.toml").read_text().splitlines()
    values = [line for line in lines if "=" in line.partition("#")[0]]
    named = {line.split()[0] for line in values if "§" in line or "Fig." in line}
    assert {"horizon", "episodes", "steps", "keep_fraction", "random_fraction", "epochs", "gamma"} <= named
    assert {"misalignment_degrees", "eval_every", "eval_episodes", "final_episodes", "seeds", "schemes"} <= named


def test_cell_names() -> None:
    assert cell_name("reach", "dense2sparse", "pan", 5.0, 0) == "reach-dense2sparse-pan05-seed0"
    assert cell_name("lift", "oracle", "orbit", 10.0, 12) == "lift-oracle-orbit10-seed12"
    assert cell_name("reach", "dense", "pan", 2.5, 0) == "reach-dense-pan2.5-seed0"


def test_matrix_is_tasks_by_schemes_by_misalignments_by_seeds() -> None:
    config = load_config(
        overrides=[
            "policy.tasks=['reach', 'lift']",
            "policy.schemes=['dense', 'oracle']",
            "policy.misalignment_degrees=[0, 5]",
            "policy.seeds=[1, 2]",
            "policy.lift.misalignment_degrees=[0]",
            "policy.lift.episodes=9",
        ]
    )
    found = cells(config.policy)
    assert len(found) == 2 * 2 * 2 + 2 * 1 * 2
    assert len({cell.name for cell in found}) == len(found)
    assert {cell.config.episodes for cell in found if cell.task == "lift"} == {9}


def test_a_cell_named_twice_is_an_error() -> None:
    with pytest.raises(ConfigError, match="reach-dense-orbit00-seed1 2 times"):
        cells(load_config(overrides=["policy.seeds=[1, 1]"]).policy)
