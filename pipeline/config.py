"""One configuration for all stages: composed from theirs, read from TOML, changed by `--set`, validated at once."""

import tomllib
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, get_args

from pydantic import Field, ValidationError

from pipeline.artifacts.names import check_name
from pipeline.config_errors import describe
from pipeline.matrix import Cell, cells
from pipeline.overrides import apply_override, put
from pipeline.studies import StudyConfig, changes, check_heard
from schemas.config import Config
from schemas.errors import ConfigError, unknown_choice
from stages.analyze.config import AnalyzeConfig
from stages.collect.config import CollectConfig
from stages.perception.config import PerceptionConfig
from stages.policy.config import SECTIONS, MatrixConfig
from stages.sim.config import CameraConfig, TaskName, WorldConfig

TASKS = get_args(TaskName)


class PipelineConfig(Config):
    """Sections of a configuration file: one per stage, two for the world they share, and the studies beside it all."""

    world: WorldConfig = WorldConfig()
    camera: CameraConfig = CameraConfig()
    collect: CollectConfig = CollectConfig()
    perception: PerceptionConfig = PerceptionConfig()
    policy: MatrixConfig = MatrixConfig()
    analyze: AnalyzeConfig = AnalyzeConfig()
    studies: dict[str, StudyConfig] = Field(default={})
    """Part of no artifact's configuration: each is a recipe for further matrices of runs."""


class Variant(NamedTuple):
    """One matrix of a study's runs."""

    study: str
    suffix: str  # of its runs' name: STUDY-VALUE…
    config: PipelineConfig

    def run(self, base: str) -> str:
        """NAME of its runs, beside the main matrix `base`."""
        return check_name(f"{base}-{self.suffix}")


def load_config(profile: str | None = None, file: Path | None = None, overrides: Sequence[str] = ()) -> PipelineConfig:
    """Configuration from a profile or a TOML file (or the defaults), with `section.key=value` overrides applied.

    Raises:
        ConfigError: no such profile or file, no TOML, an unknown key or a value out of range.
    """
    if profile and file:
        raise ConfigError("--profile and --config exclude each other: give one")
    values = read_profile(profile) if profile else read_file(file) if file else {}
    for override in overrides:
        apply_override(values, override)
    config = resolve(values)
    _check_studies(config)
    return config


def resolve(values: dict[str, Any]) -> PipelineConfig:
    """Configuration of nested values; ConfigError names the key that is wrong and what would be right."""
    _check_task_tables(values)
    try:
        return PipelineConfig.model_validate(values)
    except ValidationError as error:
        raise ConfigError(describe(error, PipelineConfig, values)) from error


def variants(config: PipelineConfig, name: str) -> list[Variant]:
    """The matrices of one study: the configuration itself, with what the study changes laid over it.

    A combination whose runs the main matrix has already is left out: its cells are the study's reference.

    Raises:
        ConfigError: a change that is no valid configuration, or that some task would not hear of.
    """
    made = []
    main = _learning(config.world, cells(config.policy))
    for change in changes(name, config.studies[name]):
        values = config.model_dump(exclude={"studies"}, exclude_unset=True)
        try:
            for key, value in change.values.items():
                put(values, key, value)
            resolved = resolve(values)
            matrix = cells(resolved.policy)
            check_heard(change.values, resolved.policy.model_dump(include=set(TASKS)), resolved.policy.tasks)
        except ConfigError as error:
            raise ConfigError(f"studies.{name}: {error}") from error
        if not set(_learning(resolved.world, matrix)) <= set(main):
            made.append((Variant(name, change.suffix, resolved), (resolved.world, matrix)))
    for index, (variant, what) in enumerate(made):
        for other, same in made[:index]:
            if what == same:
                raise ConfigError(f"studies.{name}: {other.suffix} and {variant.suffix} are the same runs")
    if not made:
        raise ConfigError(f"studies.{name}: the matrix of [policy] has all of its runs already: vary something else")
    return [variant for variant, _ in made]


def _learning(world: WorldConfig, matrix: Sequence[Cell]) -> list[tuple[str, str]]:
    """What decides how each cell learns: all but the number of its final episodes and of those recorded."""
    without = [cell.config.model_copy(update={"final_episodes": 0, "record_every": 0}) for cell in matrix]
    return [(cell.name, f"{world!r} {config!r}") for cell, config in zip(matrix, without, strict=True)]


def _check_studies(config: PipelineConfig) -> None:
    """Every variant is valid and has a name of its own: a typo is to show now, not after hours of work."""
    names = Counter(variant.suffix for study in config.studies for variant in variants(config, study))
    for suffix, count in names.items():
        if count > 1:
            raise ConfigError(f"{count} variants of the studies have the name NAME-{suffix}: rename a study or a value")


def _check_task_tables(values: dict[str, Any]) -> None:
    """[policy.reach] and [policy.lift] are laid over [policy]: they hold its keys but those that choose the task."""
    policy = values.get("policy")
    for task in TASKS:
        table = policy.get(task, {}) if isinstance(policy, dict) else {}
        if not isinstance(table, dict):
            continue  # the model says so
        if misplaced := [key for key in ("tasks", *TASKS) if key in table]:
            raise ConfigError(f"unknown key policy.{task}.{misplaced[0]}: a task's table holds no choice of tasks")
        for key in SECTIONS:
            if not isinstance(table.get(key, {}), dict):
                raise ConfigError(f"policy.{task}.{key} = {table[key]!r} is not a section")


def profiles() -> list[str]:
    """Names of the profiles that come with the package."""
    return sorted(
        entry.name.removesuffix(".toml") for entry in (files("pipeline") / "profiles").iterdir() if _is_toml(entry)
    )


def _is_toml(entry: Any) -> bool:
    return str(entry.name).endswith(".toml")


def read_profile(name: str) -> dict[str, Any]:
    """Contents of a profile."""
    if name not in profiles():
        raise ConfigError(unknown_choice("profile", name, profiles()))
    return tomllib.loads((files("pipeline") / "profiles" / f"{name}.toml").read_text(encoding="utf-8"))


def read_file(path: Path) -> dict[str, Any]:
    """Contents of a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the config {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # no TOML, no UTF-8, or nested deeper than Python's calls
        raise ConfigError(f"{path} is no TOML: {error}") from error
