"""The configuration that the artifacts of an analysis share, as one file that makes them again."""

from collections.abc import Iterable, Sequence
from typing import Any

from stages.analyze import toml_text
from stages.analyze.catalogue import Artifact
from stages.analyze.config import AnalyzeConfig
from stages.analyze.studies import Study, leaves
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
_SECTIONS = ("camera", "collect", "perception")

Values = dict[str, Any]


def config_toml(config: AnalyzeConfig, selection: Selection) -> str:
    """[world] to [studies.NAME] for `--config`; what differs between runs of one task is named in a comment."""
    sources = _sources(selection)
    sections: Values = {"world": _shared([run.manifest.config.get("world", {}) for run in selection.runs])}
    for name in _SECTIONS:
        sections[name] = _shared([each.manifest.config[name] for each in sources if name in each.manifest.config])
    policy = _policy(selection.runs)
    sections["policy"] = policy
    sections["analyze"] = config.model_dump(mode="json")
    sections["studies"] = {study.name: _study(study, selection, policy) for study in selection.studies}
    comments = [f"# Not the same in all runs, so not here: {key}" for key in _differing(selection.runs)]
    return "\n".join([*comments, toml_text.dumps({k: v for k, v in sections.items() if v})])


def _sources(selection: Selection) -> list[Artifact]:
    """The estimators and the datasets they were trained on."""
    inputs = [reference.id for each in selection.estimators for reference in each.manifest.inputs]
    datasets = [selection.sources[id] for id in dict.fromkeys(inputs) if id in selection.sources]
    return [*selection.estimators, *datasets]


def _shared(configs: Sequence[Values]) -> Values:
    """The values that all of `configs` have; nested sections as such."""
    first = configs[0] if configs else {}
    shared: Values = {}
    for key, value in first.items():
        if isinstance(value, dict):
            inner = [config[key] for config in configs if isinstance(config.get(key), dict)]
            shared[key] = _shared(inner) if len(inner) == len(configs) else {}
        elif all(key in config and config[key] == value for config in configs):
            shared[key] = value
    return shared


def _policy(runs: Sequence[Artifact]) -> Values:
    """[policy] of the first task, with [policy.TASK] for what differs in another."""
    tasks = sorted(_distinct(_identity(run, "task") for run in runs), key=lambda task: (task != "reach", task))
    sections = {}
    for task in tasks:
        mine = [run for run in runs if _identity(run, "task") == task]
        lists = {
            name: _distinct(_identity(run, key) for run in mine) for key, name in _IDENTITY.items() if key != "task"
        }
        kinds = _distinct(_identity(run, "misalignment_kind") for run in mine)
        settings = _shared([run.manifest.config.get("policy", {}) for run in mine])
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


def _identity(run: Artifact, key: str) -> Any:
    return run.manifest.config.get("run", {}).get(key)


def _distinct(values: Iterable[Any]) -> list[Any]:
    """In order: of the schemes as first met, of numbers by size."""
    found = list(dict.fromkeys(value for value in values if value is not None))
    return sorted(found) if all(isinstance(value, int | float) for value in found) else found


def _differing(runs: Sequence[Artifact]) -> list[str]:
    """Keys of [world], and of [policy] among the runs of one task, that have several values."""
    found: dict[str, None] = {}
    for task in _distinct(_identity(run, "task") for run in runs):
        mine = [dict(leaves(run.manifest.config)) for run in runs if _identity(run, "task") == task]
        for key in mine[0]:
            if key.startswith(("world.", "policy.")) and any(config.get(key) != mine[0][key] for config in mine):
                found[key] = None
    return list(found)


def _study(study: Study, selection: Selection, policy: Values) -> Values:
    """The section that makes the study's runs again: the cells they are of, what else differs, and what varies."""
    runs = [run for run in selection.every_run if run.name.split("/")[0] in study.runs]
    tasks = _distinct(_identity(run, "task") for run in runs)
    mine = [dict(leaves(run.manifest.config)) for run in runs]
    main = [dict(leaves(run.manifest.config)) for run in selection.references if _identity(run, "task") in tasks]
    fixed = {name: _distinct(_identity(run, key) for run in runs) for key, name in _IDENTITY.items()}
    cells = {key: value for name, value in fixed.items() for key in _heard(f"policy.{name}", tasks, policy)}
    others = {
        heard: mine[0][key]
        for key in (mine[0] if main else ())
        if key.startswith(("world.", "policy.")) and key not in study.keys and mine[0][key] != main[0].get(key)
        for heard in _heard(key, tasks, policy)
    }
    varied: Values = {}
    for key in study.keys:
        heard, found = _heard(_MATRIX.get(key, key), tasks, policy)[0], _distinct(config.get(key) for config in mine)
        varied[heard] = [[each] for each in found] if heard in cells else found
    kept = {key: value for key, value in (cells | others).items() if key not in varied}
    return {"question": study.question, "set": kept, "vary": varied}


def _heard(key: str, tasks: Sequence[str], policy: Values) -> list[str]:
    """Where a matrix has `key` for its `tasks`: in the section of a task that has its own, else in [policy]."""
    section, _, inner = key.partition(".")
    own = [task for task in tasks if section == "policy" and inner in dict(leaves(policy.get(task, {})))]
    shared = [key] if not own or len(own) < len(tasks) else []
    return [*shared, *(f"policy.{task}.{inner}" for task in own)]
