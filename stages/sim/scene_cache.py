"""Compiled models kept on disk: compiling robosuite's meshes takes seconds, loading what was compiled a tenth of one.

An entry belongs to the versions of all that makes it. One that is damaged is made again.
"""

import hashlib
import json
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco

from schemas.cache import cache_directory
from schemas.files import write_bytes
from schemas.integrity import file_sha256
from stages.sim.config import WorldConfig

_MAKERS = ("robosuite_scene.py", "scene.py", "meshes.py", "scene_cache.py")
_PACKAGES = ("mujoco", "robosuite", "numpy", "fast-simplification")

Made = tuple[Any, dict[str, Any]]
"""A compiled mujoco.MjModel, and plain facts about it."""


def kept(name: str, config: WorldConfig, make: Callable[[], Made]) -> Made:
    """The model `name` of this configuration from disk, else by `make`, and kept for the next time."""
    directory = _directory(config)
    found = _load(directory, name) if directory else None
    if found is not None:
        return found
    made = make()
    if directory:
        with suppress(OSError):  # a home that cannot be written to costs time, nothing else
            _save(directory, name, made)
    return made


def _directory(config: WorldConfig) -> Path | None:
    root = cache_directory()
    if root is None:
        return None
    compiled = {"robot": config.robot, "max_joint_velocity": config.max_joint_velocity}  # what the model depends on
    key = hashlib.sha256(json.dumps([compiled, _makers()]).encode()).hexdigest()[:16]
    return root / f"{config.robot}-{key}"


@cache
def _makers() -> list[str]:
    """Versions of the packages, and hashes of the code, that make a model."""
    here = Path(__file__).parent
    code = [hashlib.sha256((here / file).read_bytes()).hexdigest() for file in _MAKERS]
    return [f"{package} {version(package)}" for package in _PACKAGES] + code


def _load(directory: Path, name: str) -> Made | None:
    """None where there is no such entry, or it is not what was written."""
    try:
        card = json.loads((directory / f"{name}.json").read_bytes())
        path = directory / f"{name}.mjb"
        if file_sha256(path) != card["sha256"]:
            return None
        return mujoco.MjModel.from_binary_path(str(path)), card["facts"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _save(directory: Path, name: str, made: Made) -> None:
    """The model first, then what makes it count."""
    model, facts = made
    directory.mkdir(parents=True, exist_ok=True)
    temporary = directory / f".{name}.{os.getpid()}.mjb"
    try:
        mujoco.mj_saveModel(model, str(temporary), None)
        sha256 = file_sha256(temporary)
        temporary.replace(directory / f"{name}.mjb")
    finally:
        temporary.unlink(missing_ok=True)
    write_bytes(json.dumps({"sha256": sha256, "facts": facts}).encode(), directory / f"{name}.json")
