"""Is everything here that the pipeline needs?"""

import platform
import shutil
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import pipeline
from pipeline.machine import cuda_device, require_gl
from schemas.errors import MachineError

LOCK = Path(pipeline.__file__).parents[1] / "requirements.lock"
NEEDED_FREE = 5_000_000_000
"""Bytes that the demo and its environment leave room for."""


class Check(NamedTuple):
    """One thing looked at; `remedy` is empty when it is well."""

    name: str
    ok: bool
    found: str
    remedy: str = ""


def examine(data: Path) -> list[Check]:
    """Every check; none stops the others."""
    return [check_python(), check_versions(LOCK), check_gl(), check_gpu(), check_disk(data)]


def check_python() -> Check:
    """The interpreter."""
    ok = sys.version_info >= (3, 11)
    return Check("python", ok, platform.python_version(), "" if ok else "install Python 3.11 or newer")


def check_versions(lock: Path) -> Check:
    """Installed packages against the lock file; a local build tag such as +cpu does not matter."""
    if not lock.is_file():
        return Check("versions", True, "no lock file beside the package: versions are the installer's choice")
    pinned = dict(line.split("==") for line in lock.read_text(encoding="utf-8").split() if "==" in line)
    wrong = [text for name, wanted in pinned.items() if (text := _mismatch(name, wanted))]
    if wrong:
        return Check("versions", False, "; ".join(wrong), f"pip install --no-deps -r {lock.name}")
    return Check("versions", True, f"{len(pinned)} packages as in {lock.name}")


def _mismatch(name: str, wanted: str) -> str | None:
    try:
        found = version(name)
    except PackageNotFoundError:
        return f"{name} is missing"
    return None if found.partition("+")[0] == wanted else f"{name} is {found}, not {wanted}"


def check_gl() -> Check:
    """OpenGL without a screen: collect and every policy that sees need it."""
    try:
        return Check("gl", True, require_gl())
    except MachineError as error:
        return Check("gl", False, "none", str(error))


def check_gpu() -> Check:
    """A GPU is used where `device = "cuda"` says so; nothing needs one."""
    try:
        found = cuda_device()
    except (ImportError, OSError) as error:
        return Check("gpu", False, f"PyTorch cannot be imported: {error}", "pip install torch==2.13.0")
    return Check("gpu", True, found or "none: the CPU is used")


def check_disk(data: Path) -> Check:
    """Room where artifacts are written."""
    there = next(path for path in (data, *data.absolute().parents) if path.exists())
    free = shutil.disk_usage(there).free
    remedy = "" if free >= NEEDED_FREE else f"free {NEEDED_FREE / 1e9:.0f} GB or choose another disk with --data"
    return Check("disk", not remedy, f"{free / 1e9:.1f} GB free in {there}", remedy)
