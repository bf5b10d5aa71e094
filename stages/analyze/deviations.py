"""Where the runs differ from the paper's, or settle what it does not say, from their configurations."""

import json
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from stages.analyze import paper
from stages.analyze.formats import figure
from stages.analyze.results import Row


def deviations(runs: Sequence[Row], errors: Sequence[Row]) -> list[str]:
    """`runs` and `errors` are answers: the main runs, and the error of their estimators by misalignment."""
    if not runs:
        return _kinds(runs, errors)
    parts = [*_learning(runs), *_seeing(runs), *_estimators(runs), *_kinds(runs, errors)]
    return [_world(runs), _training(runs), *parts]


_SEEN = {
    "joints": "nothing",
    "forward_kinematics": "the gripper's position",
    "gripper_goal": "the gripper's position and how far it is to open or close",
}


def _world(runs: Sequence[Row]) -> str:
    robots = _all(runs, "robot") or ["not recorded"]
    ranges = [f"± {100 * value:g} cm" for value in _all(runs, "cube_half_range")] or ["not recorded"]
    return (
        f"Robot: {' or '.join(map(str, robots))} (the paper: {paper.ROBOT}). The scene is ours, with the cube's start "
        f"within {' or '.join(ranges)} of the table's centre: the order and the shape of curves can be compared with "
        "the paper's, levels only roughly."
    )


def _training(runs: Sequence[Row]) -> str:
    said = _by_task(runs, "training_episodes") or "not recorded"
    return f"Training episodes: {said} (the paper does not say how many)."


def _learning(runs: Sequence[Row]) -> list[str]:
    lines = []
    if any(value != paper.DISCOUNT for value in _all(runs, "gamma")):
        lines.append(f"Discount: {_by_task(runs, 'gamma')} (the paper: {paper.DISCOUNT:g}).")
    if len(_all(runs, "exploration_noise")) > 1:
        lines.append(f"Exploration noise: {_by_task(runs, 'exploration_noise')} (the paper gives none).")
    if any(_all(runs, "preactivation_penalty")):
        lines.append(
            f"The actor's output before tanh is penalised, with weight {_by_task(runs, 'preactivation_penalty')}: "
            "TD3 as published, which the paper names, has no such term."
        )
    if any(_all(runs, "exploration_correlation")):
        lines.append(
            "Exploration noise correlates with that of the step before by "
            f"{_by_task(runs, 'exploration_correlation')}, as DDPG's; TD3's does not."
        )
    return lines


def _seeing(runs: Sequence[Row]) -> list[str]:
    """What the networks are told, and how."""
    lines = []
    if _all(runs, "proprioception") not in ([], ["joints"]):
        seen = [row | {"proprioception": _SEEN.get(str(row.get("proprioception")))} for row in runs]
        lines.append(
            "Beside angles and velocities of the joints and the gripper's opening, the paper's, policies are told: "
            f"{_by_task(seen, 'proprioception')}."
        )
    scaled = [row | {"observation_scale": _sizes(row)} for row in runs]
    if any(_all(scaled, "observation_scale")):
        said = _by_task(scaled, "observation_scale")
        lines.append(
            f"The networks see parts of the observation divided by typical sizes, the paper names none: {said}."
        )
    return lines


def _sizes(run: Row) -> str | None:
    """`cube by 0.15`, of the sizes of what it observes that are not 1; None of a run that has none, or is older."""
    sizes = json.loads(run.get("observation_scale") or "{}")
    unseen = ("eef", "cube_to_eef") if run.get("proprioception") == "joints" else ()
    said = [f"{name} by {size:g}" for name, size in sizes.items() if size != 1.0 and name not in unseen]
    return " and ".join(said) or None


def _estimators(runs: Sequence[Row]) -> list[str]:
    """Where there are several: whose estimates the runs of each setting are about."""
    names = sorted(_all(runs, "estimator"))
    if len(names) < 2:
        return []
    said = [f"{name} in {_settings([run for run in runs if run.get('estimator') == name])}" for name in names]
    return [f"The paper has one estimator, these runs have {len(names)}: {'; '.join(said)}."]


def _settings(runs: Sequence[Row]) -> str:
    """`reach at 0° (oracle, dense) and 10° (sparse), lift at 0° (oracle)`."""
    told: dict[str, dict[float, list[str]]] = {}
    for run in sorted(runs, key=lambda run: (run["task"] != "reach", run["misalignment_deg"])):
        told.setdefault(run["task"], {}).setdefault(run["misalignment_deg"], []).append(run["scheme"])
    return ", ".join(
        f"{task} at "
        + " and ".join(f"{degrees:g}° ({', '.join(dict.fromkeys(found))})" for degrees, found in angles.items())
        for task, angles in told.items()
    )


def _kinds(runs: Sequence[Row], errors: Sequence[Row]) -> list[str]:
    """What each kind of misalignment does to the estimate, for the paper does not say which its shift was."""
    turned = [run for run in runs if run["misalignment_deg"]]
    used = _all(turned, "misalignment_kind")
    lines = [f"The camera is turned by {' or '.join(used)}; the paper does not say how it was."] if used else []
    ordered = sorted(errors, key=lambda row: row["estimator"])
    for name, rows in groupby(ordered, key=lambda row: row["estimator"]):
        told = {(row["misalignment_kind"], row["misalignment_deg"]): row["mean_error"] for row in rows}
        kinds = sorted({kind for kind, degrees in told if degrees}, key=lambda kind: (kind not in used, kind))
        if kinds:
            straight = next((error for (_, degrees), error in told.items() if not degrees), None)
            said = "; ".join(_kind(kind, kind in used, told) for kind in kinds)
            lines.append(f"Mean error of the estimator {name}: {figure(straight, 1, 100)} cm as calibrated; {said}.")
    return lines


def _kind(kind: str, used: bool, told: dict[tuple[str, float], float]) -> str:
    angles = sorted(degrees for each, degrees in told if each == kind and degrees)
    said = ", ".join(f"{figure(told[kind, degrees], 1, 100)} cm at {degrees:g}°" for degrees in angles)
    return f"{kind}{' (which the runs have)' if used else ''} {said}"


def _all(rows: Sequence[Row], column: str) -> list[Any]:
    """The values of a column; none where the answer was given before there was such a column."""
    return list(dict.fromkeys(row[column] for row in rows if row.get(column) is not None))


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _by_task(rows: Sequence[Row], column: str) -> str:
    """`0.9`, or where the tasks differ `reach 0.9, lift 0.97`."""
    tasks = sorted({row["task"] for row in rows if row["task"]}, key=lambda task: (task != "reach", task))
    values = {task: _all([row for row in rows if row["task"] == task], column) for task in tasks}
    said = {task: " or ".join(map(_text, found)) for task, found in values.items() if found}
    same = len(said) == len(tasks) and len(set(said.values())) == 1
    return next(iter(said.values())) if same else ", ".join(f"{task} {value}" for task, value in said.items())
