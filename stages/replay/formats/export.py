"""A run or a dataset in the format of another project, whole or absent."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

from schemas.errors import ConfigError, MachineError, unknown_choice
from schemas.progress import Progress
from stages.replay.formats.datasets import SPLITS as DATASET_SPLITS
from stages.replay.formats.datasets import dataset_source
from stages.replay.formats.episodes import Episode, Source
from stages.replay.formats.lerobot import LeRobotWriter
from stages.replay.formats.minari import MinariWriter
from stages.replay.formats.robomimic import RobomimicWriter
from stages.replay.formats.runs import SPLITS as RUN_SPLITS
from stages.replay.formats.runs import run_source

Format = Literal["lerobot", "robomimic", "minari"]
_WITH_STATES: tuple[Format, ...] = ("robomimic",)  # which plays trajectories back from them


class Writer(Protocol):
    """Takes one episode after the other, and says of how many steps; `finish` at the end, `close` in any case."""

    def add(self, episode: Episode) -> int: ...

    def finish(self) -> None: ...

    def close(self) -> None: ...


def open_source(directory: Path, form: Format, split: str | None, limit: int | None, images: bool) -> Source:
    """Episodes of the artifact in `directory` for a format, of one split or of all, at most `limit`.

    Raises:
        ArtifactError: it is damaged.
        ConfigError: it has no such split, or no episode of it.
    """
    is_dataset = (directory / "frames.parquet").exists()
    splits = DATASET_SPLITS if is_dataset else RUN_SPLITS
    if split not in (None, *splits):
        raise ConfigError(f"--split {split}: {unknown_choice('split', str(split), splits)}")
    if is_dataset:
        return dataset_source(directory, split, limit, images)
    return run_source(directory, split, limit, images, states=form in _WITH_STATES)


def export(source: Source, form: Format, target: Path, progress: Progress) -> dict[str, Any]:
    """Write every episode of `source` to `target`: a file for robomimic, a directory for the others; what was written.

    Raises:
        ConfigError: see `check_absent`.
        ArtifactError: an episode is missing or damaged.
        MachineError: there is no OpenGL to render with, or no space.
    """
    check_absent(target)
    steps = count = 0
    with (
        _published(target) as temporary,
        progress.task(f"export {source.id}", source.total) as task,
        closing(source.read()) as episodes,
        closing(_writer(source, form, temporary)) as writer,
    ):
        for episode in episodes:
            added = writer.add(episode)
            steps, count = steps + added, count + (added > 0)
            task.advance()
        writer.finish()
    return {"artifact": source.id, "format": form, "path": str(target), "episodes": count, "steps": steps}


def check_absent(target: Path) -> None:
    """Pass if something can be written as `target`.

    Raises:
        ConfigError: it exists, or its directory does not.
    """
    if target.exists() or target.is_symlink():
        raise ConfigError(f"{target} is there already: remove it or name another place with -o")
    if not target.absolute().parent.is_dir():
        raise ConfigError(f"-o {target}: there is no directory {target.parent}")


def _writer(source: Source, form: Format, path: Path) -> Writer:
    if form == "lerobot":
        return LeRobotWriter(source, path)
    return (RobomimicWriter if form == "robomimic" else MinariWriter)(source, path)


@contextmanager
def _published(target: Path) -> Iterator[Path]:
    """A path beside `target` to write to; it becomes `target` when the block ends, and is removed when it raises."""
    try:
        hidden = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        try:
            yield hidden / target.name
            (hidden / target.name).rename(target)
        finally:
            shutil.rmtree(hidden, ignore_errors=True)
    except OSError as error:
        reason = error.strerror or error
        raise MachineError(f"cannot write {target}: {reason}; free space, or name another place with -o") from error
