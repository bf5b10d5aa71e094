"""On what machine the figures were measured."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from stages.sim.processes import available_cores

_PACKAGES = ("torch", "numpy", "mujoco", "robosuite", "stable-baselines3", "gymnasium", "duckdb", "pyarrow", "mcap")


def describe() -> dict[str, object]:
    """Processor, cores, operating system and versions of what is compared."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "cpu": _cpu(),
        "cores": available_cores(),
        "platform": platform.platform(terse=True),
        "python": platform.python_version(),
        "packages": versions,
    }


def _cpu() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()
