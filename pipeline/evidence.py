"""The part of a report that is kept with the source: copied to a directory outside the data root."""

import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from pipeline.artifacts.space import is_disk_full
from schemas.errors import ArtifactError, ConfigError, MachineError
from schemas.files import write_bytes

MARK = "provenance.json"
"""The part by which an earlier evidence is known; copied first."""


def parts() -> tuple[str, ...]:
    """Files and directories of a report that are copied."""
    from stages.analyze.evidence import PARTS

    return PARTS


def check_directory(directory: Path | None, data: Path, accumulate: bool = False, runs: Sequence[str] = ()) -> None:
    """Refuse, before any work, a directory that the evidence could not be copied to; None: none is asked for.

    `runs` are the ids of those that the evidence will be of.

    Raises:
        ArtifactError: an earlier evidence to `accumulate` in is damaged.
        ConfigError: it overlaps the data root, is no directory, or holds files of the same names that are no evidence;
            or there is nothing to `accumulate` in, an evidence of an older version, or one that has other seeds of
            `runs`.
        MachineError: it cannot be written to.
    """
    if directory is None:
        if accumulate:
            raise ConfigError("--accumulate adds to an evidence: name its directory with --evidence DIR")
        return
    target, root = directory.resolve(), data.resolve()
    if target.is_relative_to(root) or root.is_relative_to(target):
        where = "inside" if target.is_relative_to(root) else "around"
        raise ConfigError(f"--evidence {directory} lies {where} the data root {data}: choose a directory beside it")
    there = next(path for path in (target, *target.parents) if path.exists())
    if not there.is_dir():
        raise ConfigError(f"--evidence {directory}: {there} is no directory")
    foreign = [part for part in parts() if (target / part).exists()]
    if foreign and not (target / MARK).exists():
        raise ConfigError(
            f"--evidence {directory}: its {foreign[0]} is of no earlier evidence, which would have a {MARK}: "
            "choose another directory"
        )
    if not os.access(there, os.W_OK | os.X_OK):
        raise MachineError(_unwritable(directory, "permission denied"))
    if accumulate and (target / MARK).exists():
        _check_earlier(directory, runs)


def _check_earlier(directory: Path, runs: Sequence[str]) -> None:
    from stages.analyze.accumulate import check_runs, read_earlier
    from stages.analyze.results import rows_of

    _require_parts(directory)
    earlier = [row["run"] for row in rows_of(read_earlier(directory)[1], "runs")]
    check_runs(earlier, [run.removeprefix("runs/") for run in runs])


def _require_parts(directory: Path) -> None:
    if missing := [part for part in parts() if not (directory / part).exists()]:
        raise ArtifactError(f"--evidence {directory} is damaged, it has no {missing[0]}: restore it, or remove it")


def planned_copy(directory: Path | None, accumulate: bool = False) -> list[dict[str, str]]:
    """For `--dry-run`."""
    return (
        [{"id": str(directory), "plan": f"{'add' if accumulate else 'copy'} the report's evidence"}]
        if directory
        else []
    )


def copy_evidence(report: Path, directory: Path | None, accumulate: bool = False) -> None:
    """Copy PARTS of a report's artifact, each file whole or not at all; what else an earlier evidence had is removed.

    With `accumulate` what an earlier evidence says of other runs is kept.

    Raises:
        ArtifactError: the report has no such parts, for an older version made it; or the earlier evidence is damaged.
        ConfigError: report and earlier evidence do not fit together.
        MachineError: the directory cannot be written to.
    """
    if directory is None:
        return
    if missing := [part for part in parts() if not (report / part).exists()]:
        raise ArtifactError(f"{report} has no {missing[0]}, for an older version made it: remove it and make it again")
    try:
        with TemporaryDirectory() as together:
            source = _with_earlier(report, directory, Path(together)) if accumulate else report
            for part in sorted(parts(), key=lambda part: part != MARK):
                _copy(source / part, directory / part)
    except OSError as error:
        if is_disk_full(error):
            raise  # has a message of its own
        raise MachineError(_unwritable(directory, str(error.strerror).lower())) from error


def _with_earlier(report: Path, directory: Path, together: Path) -> Path:
    """Where the evidence of both is: in `together`, or the report's own where there is no earlier one."""
    from stages.analyze.accumulate import accumulate

    if not (directory / MARK).exists():
        return report
    _require_parts(directory)
    accumulate(directory, report, together)
    return together


def _copy(source: Path, target: Path) -> None:
    files = _files(source) if source.is_dir() else {Path()}
    for file in sorted(files):
        (target / file).parent.mkdir(parents=True, exist_ok=True)
        write_bytes((source / file).read_bytes(), target / file)
    if source.is_dir():
        for stale in _files(target) - files:
            (target / stale).unlink()
        for directory in sorted(target.rglob("*/"), reverse=True):
            if not any(directory.iterdir()):
                directory.rmdir()


def _files(directory: Path) -> set[Path]:
    """Files below a directory, hidden ones too, relative to it."""
    return {path.relative_to(directory) for path in directory.rglob("*") if path.is_file() or path.is_symlink()}


def _unwritable(directory: Path, reason: str) -> str:
    return f"--evidence {directory} cannot be written to ({reason}): choose another directory"
