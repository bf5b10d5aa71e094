"""train-policy --offline: what logged transitions say of the matrix that is to be learnt from them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pipeline.artifacts.inputs import load
from pipeline.steps.policy import Matrix
from pipeline.steps.session import Session
from pipeline.steps.sources import complete
from schemas.errors import ConfigError
from stages.policy.config import MatrixConfig, RunConfig
from stages.sim.config import WorldConfig

_ALIKE = ("task", "scheme", "misalignment_kind", "misalignment_deg")
_POLICY_DEFAULTS = RunConfig().model_dump(mode="json")


def matrices(session: Session, name: str, offline: Sequence[str]) -> tuple[list[Matrix], str | None]:
    """A matrix for each task, scheme and misalignment of the sources, and the estimator they share.

    Seeds, networks, updates and evaluations are the configuration's; everything else is the sources'.

    Raises:
        ArtifactError: a source that is not there or not finished.
        ConfigError: sources of different worlds, estimators or observations.
    """
    ids = complete(session.root, offline, ("runs", "relabels"))
    configs = {each: load(session.root, each).config for each in ids}
    world = _same("world", configs)
    estimator, proprioception = _same("estimator", configs), _same("policy.proprioception", configs)
    oracle_sees = _same("policy.oracle_sees", configs)
    groups: dict[tuple[Any, ...], list[str]] = {}
    for each, config in configs.items():
        groups.setdefault(tuple(config["run"][key] for key in _ALIKE), []).append(each)
    made = []
    for (task, scheme, kind, degrees), members in groups.items():
        policy = session.config.policy.for_task(task).model_copy(
            update={
                "schemes": (scheme,),
                "misalignment_kind": kind,
                "misalignment_degrees": (degrees,),
                "proprioception": proprioception,
                "oracle_sees": oracle_sees,
                "warmup_episodes": 0,  # nothing is tried out at random
                "switch_episode": 0,  # rewards are as logged; what is learnt is judged by the scheme's last
            }
        )
        parts = {"world": WorldConfig.model_validate(world), "policy": MatrixConfig.model_validate(policy.model_dump())}
        of_group = replace(session, config=session.config.model_copy(update=parts))
        made.append(Matrix(of_group, name, tuple(sorted(members))))
    return made, estimator


def _same(key: str, configs: dict[str, dict[str, Any]]) -> Any:
    """What all sources have of a dotted key; one that is newer than a source had its default then."""
    found: dict[str, Any] = {}
    for each, made_with in configs.items():
        value: Any = made_with | {"policy": _POLICY_DEFAULTS | made_with["policy"]}
        for part in key.split("."):
            value = value[part]
        found.setdefault(repr(value), (each, value))
    if len(found) > 1:
        (first, _), (second, _), *_ = found.values()
        raise ConfigError(f"{first} and {second} differ in {key}: learn from them one by one")
    [(_, value)] = found.values()
    return value
