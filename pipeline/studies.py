"""Small studies beside the main matrix: a few settings vary, the estimator and everything else stay."""

import re
from collections.abc import Mapping
from itertools import product
from math import prod
from typing import Annotated, Any, NamedTuple

from pydantic import Field, field_validator

from pipeline.overrides import is_dotted
from schemas.config import Config, flatten
from schemas.errors import ConfigError

ALL = "all"
"""`--study all`; so no study has this name."""
MOST = 256
"""Variants of a study."""
SECTIONS = ("policy", "world")
"""What a run is made from besides its estimator."""

_NAME = re.compile(r"[A-Za-z0-9._-]+")
_LOGGED = {
    "policy.tasks": "run.task",
    "policy.schemes": "run.scheme",
    "policy.misalignment_kind": "run.misalignment_kind",
    "policy.misalignment_degrees": "run.misalignment_deg",
    "policy.seeds": "run.seed",
}
"""Keys that choose the cells of a matrix, and where the configuration of a cell's run has them."""

Values = Annotated[list[Any], Field(min_length=1)]


class StudyConfig(Config):
    """A question, and the settings that answer it. Keys are dotted: "policy.switch_episode", "world.touch"."""

    question: Annotated[str, Field(min_length=1)]
    set: dict[str, Any] = Field(default={})
    """Values laid over the configuration, the same for every variant."""
    vary: Annotated[dict[str, Values], Field(min_length=1)]
    """Values of each key; every combination of them, in order, is one matrix of runs."""

    @field_validator("set", "vary", mode="before")
    @classmethod
    def _dotted(cls, value: object) -> object:
        """Unquoted dotted keys are nested tables in TOML: the same is meant."""
        return dict(flatten(value)) if isinstance(value, dict) else value


class Change(NamedTuple):
    """What one variant changes, and what tells its runs' name from that of the main matrix."""

    suffix: str  # STUDY-VALUE…
    values: dict[str, Any]


def changes(name: str, study: StudyConfig) -> list[Change]:
    """The variants of a study; ConfigError when a key cannot be of a study, or a value not part of a name."""
    _check(name, study)
    made = []
    for values in product(*study.vary.values()):
        suffix = "-".join([name, *map(_part, values)])
        if not _NAME.fullmatch(suffix) or ".." in suffix:
            raise ConfigError(
                f"studies.{name}: no run can be named by {suffix!r}; values that vary are numbers, true or false, "
                "lists of them, or words of letters, digits, '.', '_' and '-'"
            )
        made.append(Change(suffix, {**study.set, **dict(zip(study.vary, values, strict=True))}))
    return made


def _check(name: str, study: StudyConfig) -> None:
    if not _NAME.fullmatch(name) or ".." in name or name == ALL:
        raise ConfigError(f"no study can be named {name!r}: letters, digits, '.', '_' and '-' only, and not '{ALL}'")
    for key in [*study.set, *study.vary]:
        if not is_dotted(key) or key.split(".")[0] not in SECTIONS:
            valid = " and ".join(f"[{section}]" for section in SECTIONS)
            raise ConfigError(
                f"studies.{name}: {key!r} cannot be changed: a study trains other runs with the same estimator, "
                f"so it changes dotted keys of {valid} only"
            )
    if (count := prod(map(len, study.vary.values()))) > MOST:
        raise ConfigError(f"studies.{name}.vary has {count:,} combinations, each a matrix of runs; at most {MOST}")
    if both := [key for key in study.vary if key in study.set]:
        raise ConfigError(f"studies.{name}: {both[0]} is both in set and in vary: leave one")


def _part(value: object) -> str:
    """A value as part of a name: 25, 0.97, 1e-05, true, relabel, 128_128."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}".replace("+", "")
    return "_".join(map(_part, value)) if isinstance(value, list) else str(value)


def check_heard(changed: Mapping[str, Any], policy: Mapping[str, Any], tasks: tuple[str, ...]) -> None:
    """ConfigError when [policy.reach] or [policy.lift] hides what a study changes in [policy] from that task's runs."""
    for key in changed:
        section, _, inner = key.partition(".")
        for task in tasks if section == "policy" else ():
            of_task = f"policy.{task}.{inner}"
            if inner in dict(flatten(policy.get(task, {}))) and of_task not in changed:
                raise ConfigError(
                    f"{key} is not heard by {task}, which has its own in [policy.{task}]: change {of_task} as well, "
                    f"or leave {task} out of policy.tasks"
                )


def logged_keys(study: StudyConfig, tasks: tuple[str, ...]) -> tuple[str, ...]:
    """What varies, as dotted keys of the configuration in a run's manifest, where a task's own are merged."""
    merged = (re.sub(rf"^policy\.({'|'.join(tasks)})\.", "policy.", key) for key in study.vary)
    return tuple(dict.fromkeys(_LOGGED.get(key, key) for key in merged))
