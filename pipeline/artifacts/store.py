"""Making artifacts: every one is complete, or says that it is not, or is absent."""

import shutil
import tempfile
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.artifacts.environment import code, environment
from pipeline.artifacts.lock import ArtifactLock
from pipeline.artifacts.manifests import (
    MANIFEST,
    differences,
    list_files,
    read_manifest,
    write_manifest,
)
from pipeline.artifacts.names import STAGE_OF, artifact_path, split_id
from schemas.errors import ArtifactError, ConfigError
from schemas.files import fsync_directory, leads_out, remove_halves, write_bytes
from schemas.integrity import check_file
from schemas.manifest import STUDIES, InputRef, Manifest, Origin, config_sha256, parse_manifest

BEFORE_REPAIR = ".manifest.before-repair.json"
"""Beside the manifest of a damaged artifact that is to be made whole again: the one it had."""


@dataclass(frozen=True)
class Request:
    """What is asked for: an artifact, everything it depends on, nothing about how it is made."""

    id: str
    config: dict[str, Any]
    inputs: list[InputRef] = field(default_factory=list)
    defaults: dict[str, Any] = field(default_factory=dict)
    """Values of keys that an older version did not know yet: what it did without them."""
    device: str = "cpu"
    """What its networks run on. Not its identity: either device's result is as good, but they round differently."""
    grows: bool = False
    """Some input is still being written: what was made of it may know less than there is by now."""

    @property
    def config_sha256(self) -> str:
        """Hash that decides whether an existing artifact is the one asked for."""
        return config_sha256(self.config)

    def differences(self, made: dict[str, Any]) -> list[str]:
        """Leaves of the configuration that something was `made` with that are not the ones asked for."""
        return differences(made, self.config, self.defaults)

    def is_answered_by(self, manifest: Manifest) -> bool:
        """Nothing is to be done: a complete artifact of this config, made from these inputs, shows these studies."""
        if self.grows:
            return False
        shows_the_same = manifest.config.get(STUDIES) == self.config.get(STUDIES)
        return manifest.status == "complete" and manifest.inputs == self.inputs and shows_the_same


class Build:
    """An artifact being written, locked until the `with` block ends.

    `path` is where the stage writes. Leaving the block by an exception, whichever it is, keeps the status `running`:
    `--resume` goes on from there. What is new and still empty is removed, so is a report. `failed` is only what the
    stage itself reported as such, by `fail`.
    """

    def __init__(self, manifest: Manifest, path: Path, target: Path, lock: ArtifactLock, resumed: bool) -> None:
        self.path = path
        self.resumed = resumed
        self._manifest = manifest
        self._target = target
        self._lock = lock

    def __enter__(self) -> "Build":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: object) -> None:
        try:
            if error is not None:
                self._abandon()
        finally:
            self._lock.release()

    def note_renderer(self, gl_renderer: str) -> None:
        """Record which OpenGL drew the frames."""
        recorded = self._manifest.environment.model_copy(update={"gl_renderer": gl_renderer})
        self._record(environment=recorded)

    def finish(self, summary: dict[str, Any]) -> Manifest:
        """List and hash the files, record the summary, publish."""
        self._close("complete", summary)
        self._take_back_identity()
        if self.path != self._target:
            publish(self.path, self._target)
        return self._manifest

    def fail(self, reason: str, summary: dict[str, Any] | None = None) -> Manifest:
        """Record that it went wrong; what was written stays and counts."""
        self._close("failed", {**(summary or {}), "error": reason})
        return self._manifest

    def _close(self, status: str, summary: dict[str, Any]) -> None:
        remove_halves(self.path)
        self._record(status=status, summary=summary, files=list_files(self.path))

    def _take_back_identity(self) -> None:
        """What was damaged and is made again byte for byte is the artifact that others are made from."""
        kept = self.path / BEFORE_REPAIR
        if not kept.exists():
            return
        before = parse_manifest(kept.read_bytes(), kept)
        if before.files == self._manifest.files:
            write_bytes(kept.read_bytes(), self.path / MANIFEST)
            self._manifest = before
        kept.unlink()

    def _record(self, **changes: object) -> None:
        changed = self._manifest.model_copy(update=changes)
        others = [each for each in changed.resumed_from if each != _origin(changed)]
        changed = changed.model_copy(update={"resumed_from": others})
        write_manifest(changed, self.path)
        self._manifest = changed

    def _abandon(self) -> None:
        aside = self.path != self._target
        empty = self._manifest.status == "running" and not self.resumed and not self._has_content()
        if aside or empty:
            shutil.rmtree(self.path, ignore_errors=True)  # a published report is not there any more

    def _has_content(self) -> bool:
        return any(path.name != MANIFEST and path.is_file() for path in self.path.rglob("*"))


class Store:
    """Artifacts under one data root."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, artifact_id: str) -> Path:
        """Directory of an artifact, whether or not it exists."""
        return artifact_path(self.root, artifact_id)

    def existing(self, request: Request, resume: bool) -> Manifest | None:
        """Manifest of the artifact of this id if the request may go on with it; None when there is none.

        Raises:
            ConfigError: the name is taken by another config or input, or it was not finished and `resume` is not set,
                or was begun on another device.
            ArtifactError: what is there cannot be read.
        """
        path = self.path(request.id)
        if not path.exists():
            return None
        manifest = read_manifest(path, request.id)
        self._check_same(request, manifest)
        if manifest.status == "complete":
            for file in manifest.files:
                check_file(path, manifest.id, file, sha256=None)
        elif not resume:
            raise ConfigError(f"{request.id} {_ended(manifest)}, or remove {path}")
        elif manifest.environment.device not in (None, request.device):
            raise ConfigError(
                f"{request.id} was begun on {manifest.environment.device}, and {request.device} rounds differently: "
                f"resume it with device={manifest.environment.device}, or choose another --name"
            )
        return manifest

    def _check_same(self, request: Request, manifest: Manifest) -> None:
        changed = manifest.config_sha256 != request.config_sha256 and request.differences(manifest.config)
        if changed:
            raise ConfigError(f"{request.id} exists with another config ({', '.join(changed)}): choose another --name")
        if manifest.inputs != request.inputs and not _replaceable(request.id):
            before = ", ".join(ref.id for ref in manifest.inputs) or "nothing"
            raise ConfigError(
                f"{request.id} was made from other inputs ({before}, as they were then): choose another --name"
            )

    def begin(self, request: Request, resume: bool) -> Build | Manifest:
        """Start or continue an artifact; the manifest instead when it is complete already."""
        lock = ArtifactLock(self.root, request.id)
        lock.acquire()
        try:
            manifest = self.existing(request, resume)
            if manifest and request.is_answered_by(manifest):
                lock.release()
                return manifest
            return self._build(request, manifest, lock)
        except BaseException:
            lock.release()
            raise

    def _build(self, request: Request, manifest: Manifest | None, lock: ArtifactLock) -> Build:
        target = self.path(request.id)
        if manifest and not _replaceable(request.id):
            check_links(target)
            running = _resumed(manifest, request.device)
            write_manifest(running, target)
            return Build(running, target, target, lock, resumed=True)
        fresh = _new_manifest(request)
        path = _prepare(target, fresh)
        if not _replaceable(request.id):
            path = path.rename(target)
        return Build(fresh, path, target, lock, resumed=False)


def _replaceable(artifact_id: str) -> bool:
    """A report is a view of its inputs: built aside, and built anew when there are more of them."""
    return split_id(artifact_id)[0] == "reports"


def _new_manifest(request: Request) -> Manifest:
    kind, names = split_id(request.id)
    return Manifest(
        id=request.id,
        stage=STAGE_OF[kind],
        name="/".join(names),
        status="running",
        created_at=datetime.now(UTC).isoformat(timespec="seconds"),
        config=request.config,
        config_sha256=request.config_sha256,
        inputs=request.inputs,
        code=code(),
        environment=environment(request.device),
    )


def _resumed(manifest: Manifest, device: str) -> Manifest:
    """The manifest of what is gone on with here: it remembers what it was begun by and on.

    That this is the same is seen when its renderer is known: until then it is the one of before.
    """
    now = {"code": code(), "environment": environment(device, manifest.environment.gl_renderer)}
    known, before = manifest.resumed_from, _origin(manifest)
    origins = known if before in known else [*known, before]
    return manifest.model_copy(update={"status": "running", "files": [], "resumed_from": origins, **now})


def _origin(manifest: Manifest) -> Origin:
    return Origin(code=manifest.code, environment=manifest.environment)


def _prepare(target: Path, manifest: Manifest) -> Path:
    """A directory beside `target`, hidden, that holds the manifest: no artifact is ever seen without one."""
    target.parent.mkdir(parents=True, exist_ok=True)
    for abandoned in target.parent.glob(f".{target.name}.building-*"):
        if abandoned.is_symlink():
            abandoned.unlink()
        else:
            shutil.rmtree(abandoned)
    path = Path(tempfile.mkdtemp(prefix=f".{target.name}.building-", dir=target.parent))
    path.chmod(0o755)
    write_manifest(manifest, path)
    return path


def publish(path: Path, target: Path) -> None:
    """Rename `path` to `target`; what was there before is deleted after."""
    old = path.with_name(f"{path.name}-old")
    if target.exists():
        target.rename(old)
    path.rename(target)
    fsync_directory(target.parent)
    if old.exists():
        shutil.rmtree(old)


def check_links(path: Path) -> None:
    """ArtifactError where a link in the artifact leads out of it: what is written there would be written elsewhere."""
    for each in path.rglob("*"):
        if each.is_symlink() and leads_out(each, path):
            raise ArtifactError(f"{each} is a link that leads out of the artifact: put what it leads to in its place")


def _ended(manifest: Manifest) -> str:
    """How what is not complete ended, and how to go on."""
    if manifest.status == "running":
        return "was interrupted earlier: add --resume to go on from its last checkpoint"
    reason = manifest.summary.get("error", "no reason recorded")
    return (
        f"failed earlier ({reason}): add --resume to try again from its last checkpoint, which ends the same where "
        "nothing has changed, choose another --name for another configuration"
    )
