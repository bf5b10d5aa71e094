"""What an artifact was made with and on: recorded in its manifest to explain differences between machines."""

import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pipeline
from schemas.manifest import Code, Environment

PACKAGES = (
    "duckdb",
    "mcap",
    "mujoco",
    "numba",
    "numpy",
    "polars",
    "pyarrow",
    "rerun-sdk",
    "robosuite",
    "safetensors",
    "torch",
)
SOURCES = ("pipeline", "stages", "schemas", "rerun_blueprints")


def environment(device: str, gl_renderer: str | None = None) -> Environment:
    """This machine, interpreter and the packages results depend on; the device and the renderer that are used."""
    return Environment(
        python=platform.python_version(),
        platform=platform.platform(),
        cpu=cpu_model(),
        gpu=gpu_model(),
        gl_renderer=gl_renderer,
        device=device,
        packages=package_versions(),
    )


@cache
def package_versions() -> dict[str, str]:
    """Installed versions of the packages results depend on."""
    found: dict[str, str] = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def cpu_model() -> str:
    """Model name from the kernel, else what Python knows."""
    return _field(Path("/proc/cpuinfo"), "model name") or platform.processor() or platform.machine()


def gpu_model(driver: Path = Path("/proc/driver/nvidia/gpus")) -> str | None:
    """First NVIDIA GPU by the driver's own word: no CUDA context is made for a line of text."""
    models = (_field(path, "Model") for path in sorted(driver.glob("*/information")))
    return next((model for model in models if model), None)


def _field(path: Path, name: str) -> str | None:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    values = (line.partition(":")[2].strip() for line in lines if line.partition(":")[0].strip() == name)
    return next(values, None)


@cache
def code() -> Code:
    """Version of this code; git commit and state when it runs from a checkout."""
    source = Path(pipeline.__file__).parent
    if _git(source, "ls-files", "--error-unmatch", "__init__.py") is None:
        return Code(version=pipeline.__version__, git_commit=None, dirty=None)
    status = _git(source.parent, "status", "--porcelain", "--", *SOURCES)
    return Code(
        version=pipeline.__version__,
        git_commit=_git(source, "rev-parse", "HEAD"),
        dirty=None if status is None else bool(status),
    )


def _git(directory: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=directory, capture_output=True, text=True, check=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
