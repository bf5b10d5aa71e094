"""What a step is given, and what it answers."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pipeline.artifacts.inputs import input_ref, load_complete
from pipeline.artifacts.store import Build, Request, Store
from pipeline.config import PipelineConfig
from pipeline.machine import require_gl
from schemas.errors import DivergedError
from schemas.manifest import InputRef, Manifest
from schemas.progress import Progress

Did = Literal["made", "resumed", "nothing", "failed"]


@dataclass(frozen=True)
class Session:
    """Artifacts, configuration and manners of one command."""

    store: Store
    config: PipelineConfig
    progress: Progress
    resume: bool

    @property
    def root(self) -> Path:
        """Data root."""
        return self.store.root

    def pin(self, artifact_id: str) -> InputRef:
        """Verify an input and pin it; ArtifactError when it is missing, unfinished or damaged."""
        load_complete(self.root, artifact_id)
        return input_ref(self.root, artifact_id)


@dataclass(frozen=True)
class Outcome:
    """One artifact after a step."""

    id: str
    path: Path
    did: Did
    summary: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "id": self.id,
            "path": str(self.path),
            "did": self.did,
            "summary": self.summary,
            "seconds": round(self.seconds, 3),
        }


def make(
    session: Session, request: Request, stage: Callable[[Build], dict[str, Any]], renders: bool = False
) -> Outcome:
    """Make one artifact: `stage` writes into the build's path and returns the summary. No-op when it is complete.

    MachineError where it `renders` and there is no OpenGL: asked before MuJoCo is imported, which would fail on it.
    DivergedError where the work came to a bad end: the artifact is `failed` then, and says why.
    """
    path = session.store.path(request.id)
    begun = session.store.begin(request, session.resume)
    if isinstance(begun, Manifest):
        return Outcome(request.id, path, "nothing", begun.summary)
    started = time.monotonic()
    with begun as build:
        if renders:
            build.note_renderer(require_gl())
        try:
            summary = stage(build)
        except DivergedError as error:
            build.fail(str(error))
            raise
        manifest = build.finish(summary)
    did: Did = "resumed" if build.resumed else "made"
    return Outcome(request.id, path, did, manifest.summary, time.monotonic() - started)


def planned(session: Session, request: Request) -> dict[str, str]:
    """What `make` would do, for `--dry-run`; ConfigError where it would refuse."""
    manifest = session.store.existing(request, session.resume)
    if manifest is None:
        return {"id": request.id, "plan": "make"}
    if manifest.status != "complete":
        return {"id": request.id, "plan": "resume"}
    return {"id": request.id, "plan": "nothing" if request.is_answered_by(manifest) else "make again: new inputs"}
