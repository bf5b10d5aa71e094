"""One configuration for all stages: composed from theirs, read from TOML, changed by `--set`, validated at once."""

import re
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from pipeline.config_errors import describe
from schemas.config import Config
from schemas.errors import ConfigError, unknown_choice
from stages.analyze.config import AnalyzeConfig
from stages.collect.config import CollectConfig
from stages.perception.config import PerceptionConfig
from stages.policy.config import MatrixConfig
from stages.sim.config import CameraConfig, TaskName, WorldConfig

TASKS = get_args(TaskName)
_BARE_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")


class PipelineConfig(Config):
    """Sections of a configuration file, one per stage and two for the world they share."""

    world: WorldConfig = WorldConfig()
    camera: CameraConfig = CameraConfig()
    collect: CollectConfig = CollectConfig()
    perception: PerceptionConfig = PerceptionConfig()
    policy: MatrixConfig = MatrixConfig()
    analyze: AnalyzeConfig = AnalyzeConfig()


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
    _check_task_tables(values)
    try:
        return PipelineConfig.model_validate(values)
    except ValidationError as error:
        raise ConfigError(describe(error, PipelineConfig, values)) from error


def _check_task_tables(values: dict[str, Any]) -> None:
    """[policy.reach] and [policy.lift] are laid over [policy]: they hold its keys but those that choose the task."""
    policy = values.get("policy")
    for task in TASKS:
        table = policy.get(task, {}) if isinstance(policy, dict) else {}
        if not isinstance(table, dict):
            continue  # the model says so
        if misplaced := [key for key in ("tasks", *TASKS) if key in table]:
            raise ConfigError(f"unknown key policy.{task}.{misplaced[0]}: a task's table holds no choice of tasks")
        if not isinstance(table.get("td3", {}), dict):
            raise ConfigError(f"policy.{task}.td3 = {table['td3']!r} is not a section")


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
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is no TOML: {error}") from error


def apply_override(values: dict[str, Any], override: str) -> None:
    """Set one `section.key=value` in nested `values`; the value is a TOML literal, a bare word is a string."""
    key, separator, text = override.partition("=")
    *sections, last = (part.strip() for part in key.split("."))
    if not separator or not sections or not all([*sections, last]):
        raise ConfigError(f"--set {override!r} is not of the form section.key=value, such as policy.episodes=300")
    table = values
    for depth, section in enumerate(sections):
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {override!r}: {'.'.join(sections[: depth + 1])} is a value, not a section")
    table[last] = parse_value(text.strip(), override)


def parse_value(text: str, override: str) -> Any:
    """Value of a TOML literal, or the text itself when it is a bare word."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError as error:
        if _BARE_WORD.fullmatch(text):
            return text
        raise ConfigError(
            f"--set {override!r}: the value is no TOML literal such as 3, 0.5, true, [0, 5] or ['dense', 'sparse']"
        ) from error
    if len(parsed) != 1:
        raise ConfigError(f"--set {override!r}: one value only")
    return parsed["value"]
