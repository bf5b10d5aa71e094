"""The configuration that the artifacts of an analysis share, as one file that makes them again."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from schemas.config import flatten
from stages.analyze import toml_text
from stages.analyze.config import AnalyzeConfig
from stages.analyze.results import Row
from stages.analyze.studies import Study
from stages.analyze.study import Selection

_IDENTITY = {
    "task": "tasks",
    "scheme": "schemes",
    "misalignment_deg": "misalignment_degrees",
    "seed": "seeds",
}
"""Key of a run's identity: key of [policy] that lists its values."""
_MATRIX = {f"run.{key}": f"policy.{name}" for key, name in _IDENTITY.items()} | {
    "run.misalignment_kind": "policy.misalignment_kind"
}
INPUTS = ("camera", "collect", "perception")
"""Sections of what the runs descend from."""

Values = dict[str, Any]


@dataclass(frozen=True)
class _Run:
    name: str  # NAME, of its matrix
    main: bool
    config: Values


def config_toml(
    config: AnalyzeConfig, studies: Sequence[Study], inputs: Mapping[str, Values], runs: Sequence[Row]
) -> str:
    """[world] to [studies.NAME] for `--config`; what differs between runs of one task is named in a comment.

    `inputs` are the sections of what the runs descend from, `runs` the answer of that name.
    """
    every = [_Run(row["name"], row["main"], json.loads(row["config"])) for row in runs]
    main = [run for run in every if run.main]
    policy = _policy(main)
    sections: Values = {"world": shared([run.config.get("world", {}) for run in main])}
    sections |= {name: inputs.get(name) for name in INPUTS}
    sections["policy"] = policy
    sections["analyze"] = config.model_dump(mode="json")
    sections["studies"] = {study.name: _study(study, every, policy) for study in studies}
    comments = [f"# Not the same in all runs, so not here: {key}" for key in _differing(main)]
    return "\n".join([*comments, toml_text.dumps({k: v for k, v in sections.items() if v})])


def of_inputs(selection: Selection) -> dict[str, Values]:
    """[camera], [collect] and [perception] as the datasets and estimators share them."""
    configs = [each.manifest.config for each in [*selection.estimators, *selection.datasets]]
    return {name: shared([config[name] for config in configs if name in config]) for name in INPUTS}


def shared(configs: Sequence[Values]) -> Values:
    """The values that all of `configs` have; nested sections as such."""
    first = configs[0] if configs else {}
    same: Values = {}
    for key, value in first.items():
        if isinstance(value, dict):
            inner = [config[key] for config in configs if isinstance(config.get(key), dict)]
            same[key] = shared(inner) if len(inner) == len(configs) else {}
        elif all(key in config and config[key] == value for config in configs):
            same[key] = value
    return same


def _policy(runs: Sequence[_Run]) -> Values:
    """[policy] of the first task, with [policy.TASK] for what differs in another."""
    tasks = sorted(_distinct(_identity(run, "task") for run in runs), key=lambda task: (task != "reach", task))
    sections = {}
    for task in tasks:
        mine = [run for run in runs if _identity(run, "task") == task]
        lists = {
            name: _distinct(_identity(run, key) for run in mine) for key, name in _IDENTITY.items() if key != "task"
        }
        kinds = _distinct(_identity(run, "misalignment_kind") for run in mine)
        settings = shared([run.config.get("policy", {}) for run in mine])
        sections[task] = lists | {"misalignment_kind": kinds[0] if kinds else None} | settings
    if not tasks:
        return {}
    base = sections[tasks[0]]
    others = {task: _changes(sections[task], base) for task in tasks[1:]}
    return {"tasks": tasks} | base | {task: changes for task, changes in others.items() if changes}


def _changes(values: Values, base: Values) -> Values:
    changed: Values = {}
    for key, value in values.items():
        if isinstance(value, dict):
            changed |= {key: inner} if (inner := _changes(value, base.get(key, {}))) else {}
        elif value != base.get(key):
            changed[key] = value
    return changed


def _identity(run: _Run, key: str) -> Any:
    return run.config.get("run", {}).get(key)


def _distinct(values: Iterable[Any]) -> list[Any]:
    """In order: of the schemes as first met, of numbers by size."""
    found: list[Any] = []
    for value in values:  # lists among them cannot be keys of a dict
        if value is not None and value not in found:
            found.append(value)
    return sorted(found) if all(isinstance(value, int | float) for value in found) else found


def _differing(runs: Sequence[_Run]) -> list[str]:
    """Keys of [world], and of [policy] among the runs of one task, that have several values."""
    found: dict[str, None] = {}
    for task in _distinct(_identity(run, "task") for run in runs):
        mine = [dict(flatten(run.config)) for run in runs if _identity(run, "task") == task]
        for key in mine[0]:
            if key.startswith(("world.", "policy.")) and any(config.get(key) != mine[0][key] for config in mine):
                found[key] = None
    return list(found)


def _study(study: Study, every: Sequence[_Run], policy: Values) -> Values:
    """The section that makes the study's runs again: the cells they are of, what else differs, and what varies."""
    runs = [run for run in every if run.name in study.runs]
    tasks = _distinct(_identity(run, "task") for run in runs)
    mine = [dict(flatten(run.config)) for run in runs]
    main = [
        dict(flatten(run.config))
        for run in every
        if run.main and run.name == study.main and _identity(run, "task") in tasks
    ]
    cells = {
        heard: values for name, values in _cells(runs).items() for heard in _heard(f"policy.{name}", tasks, policy)
    }
    others = {
        heard: mine[0][key]
        for key in (mine[0] if main else ())
        if key.startswith(("world.", "policy.")) and key not in study.keys and mine[0][key] != main[0].get(key)
        for heard in _heard(key, tasks, policy)
    }
    varied = {_heard(_MATRIX.get(key, key), tasks, policy)[0]: _values(key, study, runs) for key in study.keys}
    kept = {key: value for key, value in (cells | others).items() if key not in varied}
    return {"question": study.question, "set": kept, "vary": varied}


def _cells(runs: Sequence[_Run]) -> Values:
    """What of [policy] chooses these cells: its lists, and the kind of misalignment."""
    lists: Values = {name: _distinct(_identity(run, key) for run in runs) for key, name in _IDENTITY.items()}
    kinds = _distinct(_identity(run, "misalignment_kind") for run in runs)
    return lists | ({"misalignment_kind": kinds[0]} if len(kinds) == 1 else {})


def _values(key: str, study: Study, runs: Sequence[_Run]) -> list[Any]:
    """What `key` was in the variants, each value once; a list of the matrix is as long as it is in each of them."""
    listed = key in [f"run.{each}" for each in _IDENTITY]
    by_name = {
        name: _distinct(dict(flatten(run.config)).get(key) for run in runs if run.name == name) for name in study.runs
    }
    return _distinct(by_name.values() if listed else chain.from_iterable(by_name.values()))


def _heard(key: str, tasks: Sequence[str], policy: Values) -> list[str]:
    """Where a matrix has `key` for its `tasks`: in the section of a task that has its own, else in [policy]."""
    section, _, inner = key.partition(".")
    own = [task for task in tasks if section == "policy" and inner in dict(flatten(policy.get(task, {})))]
    shared = [key] if not own or len(own) < len(tasks) else []
    return [*shared, *(f"policy.{task}.{inner}" for task in own)]
