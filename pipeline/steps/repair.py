"""A damaged artifact becomes an unfinished one: what is whole stays, `--resume` makes the rest."""

import shutil
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.artifacts.inputs import load
from pipeline.artifacts.lock import ArtifactLock
from pipeline.artifacts.manifests import MANIFEST, write_manifest
from pipeline.artifacts.names import split_id
from pipeline.artifacts.store import BEFORE_REPAIR, Store, check_links
from schemas.errors import ArtifactError, ConfigError
from schemas.files import leads_out, read_parquet, write_bytes
from schemas.integrity import check_config, problem
from schemas.manifest import Manifest
from schemas.mcap_files import read_messages

_READ: dict[str, Callable[[Path], object]] = {
    ".parquet": read_parquet,
    ".mcap": lambda path: deque(read_messages(path), maxlen=0),
}
_ADDITIONS = ("recordings/", "failure/")
"""What a run has besides its log and weights: it is whole without."""
_THEN = {
    "datasets": "the command that made it, with --resume, collects what is missing",
    "estimators": "the command that made it, with --resume, trains it again, or only tests it",
    "relabels": "the command that made it, with --resume, labels what is missing",
}


@dataclass(frozen=True)
class Repaired:
    """What was kept of an artifact, and what was dropped."""

    id: str
    kept: str
    lost: tuple[str, ...]
    then: str  # what to do next; empty: nothing

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {"id": self.id, "is_whole": not self.lost, "kept": self.kept, "lost": list(self.lost), "then": self.then}

    def message(self) -> str:
        """A sentence for a person."""
        if not self.lost:
            found = f"{self.id}: {self.kept}, nothing is damaged"
        else:
            found = f"{self.id}: {self.kept} kept; dropped: {'; '.join(self.lost)}"
        return found + (f"; {self.then}" if self.then else "")


def repair(store: Store, artifact_id: str, dry_run: bool) -> Repaired:
    """Drop what is damaged; with `dry_run` only say what would be.

    Raises:
        ConfigError: it is a report, or another process writes it.
        ArtifactError: its manifest cannot be read, or its configuration was edited.
    """
    kind, names = split_id(artifact_id)
    if kind == "reports":
        raise ConfigError(f"{artifact_id} is a view of its runs: `pipeline analyze --name {names[0]}` makes it again")
    lock = ArtifactLock(store.root, artifact_id)
    lock.acquire()
    try:
        manifest = load(store.root, artifact_id)
        check_config(manifest)
        path = store.path(artifact_id)
        if manifest.status == "running":
            check_links(path)
        if manifest.status == "running" and kind != "runs":
            return _unlisted(store, manifest, dry_run)
        damaged = {file.path: found for file in manifest.files if (found := problem(path, file)) is not None}
        return (_run if kind == "runs" else _files)(store, manifest, damaged, dry_run)
    finally:
        lock.release()


def _files(store: Store, manifest: Manifest, damaged: Mapping[str, str], dry_run: bool) -> Repaired:
    """Of files that are made one by one those that are whole stay."""
    whole = [file for file in manifest.files if file.path not in damaged]
    kept = f"{len(whole):,} of {len(manifest.files):,} files"
    if damaged and not dry_run:
        _drop(store, manifest, damaged)
        _unfinished(store, manifest, damaged.values())
    return Repaired(manifest.id, kept, tuple(damaged.values()), _THEN[split_id(manifest.id)[0]] if damaged else "")


def _unlisted(store: Store, manifest: Manifest, dry_run: bool) -> Repaired:
    """Of what is not finished no hashes are known: what counts is whether a file can be read to its end."""
    path = store.path(manifest.id)
    files = [each for each in sorted(path.rglob("*")) if each.suffix in _READ and not each.name.startswith(".")]
    damaged = [each.relative_to(path).as_posix() for each in files if not _is_readable(each)]
    if not dry_run:
        _drop(store, manifest, damaged)
    kept = f"{len(files) - len(damaged):,} of {len(files):,} Parquet and MCAP files, not finished"
    then = _THEN[split_id(manifest.id)[0]] if damaged else "--resume goes on, and looks at checkpoints itself"
    return Repaired(manifest.id, kept, tuple(f"{each} cannot be read to its end" for each in damaged), then)


def _is_readable(path: Path) -> bool:
    try:
        _READ[path.suffix](path)
    except ArtifactError:
        return False
    return True


def _run(store: Store, manifest: Manifest, damaged: Mapping[str, str], dry_run: bool) -> Repaired:
    from stages.policy.checkpoint import damage
    from stages.policy.salvage import assess, cut

    path = store.path(manifest.id)
    if manifest.status == "running":  # no manifest vouches for what has ended yet
        damaged = damage(path)
    identity = {"run": "/".join(split_id(manifest.id)[1])} | manifest.config["run"]
    whole = assess(path, identity, damaged, from_logs=bool(manifest.config.get("sources")))
    lost = (*damaged.values(), *whole.lost)
    if damaged and all(name.startswith(_ADDITIONS) for name in damaged) and not whole.lost:
        if not dry_run:
            _drop(store, manifest, damaged)
            left = [file for file in manifest.files if file.path not in damaged]
            write_manifest(manifest.model_copy(update={"files": left}), path)
        return Repaired(manifest.id, whole.kept, lost, "a replay renders its frames again")
    if lost and not dry_run:
        _drop(store, manifest, damaged)
        cut(path, whole)
        _unfinished(store, manifest, lost)
    point = max(whole.checkpoints, default=None)
    start = f"from checkpoint {point}" if point else "anew, from its first episode"
    then = f"the command that made it, with --resume, trains it {start}" if lost else ""
    return Repaired(manifest.id, whole.kept, lost, then)


def _drop(store: Store, manifest: Manifest, damaged: Iterable[str]) -> None:
    """Remove files, or what is in their place; what a name leads to outside of the artifact is not ours."""
    directory = store.path(manifest.id)
    for name in damaged:
        path = directory / name
        if leads_out(path.parent, directory):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _unfinished(store: Store, manifest: Manifest, lost: Iterable[str]) -> None:
    """Status `running` again; what it was is kept beside, for what is made again byte for byte is that again."""
    path = store.path(manifest.id)
    if manifest.status == "complete":
        write_bytes((path / MANIFEST).read_bytes(), path / BEFORE_REPAIR)
    changed = {"status": "running", "files": [], "summary": {"repaired": list(lost)}}
    write_manifest(manifest.model_copy(update=changed), path)
