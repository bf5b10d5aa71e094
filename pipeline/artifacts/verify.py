"""Whether artifacts are what was written: every file against the hash in its manifest."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from pipeline.artifacts.inputs import load
from pipeline.artifacts.manifests import manifest_sha256
from pipeline.artifacts.names import artifact_path
from schemas.errors import PipelineError
from schemas.integrity import EDITED, problem, unlisted
from schemas.manifest import Manifest, config_sha256
from schemas.progress import Progress

_UNIT = 1_000_000  # bytes
_THREADS = 4  # hashing is the disk's and the processor's work, not Python's


@dataclass(frozen=True)
class Verdict:
    """What was found of one artifact."""

    id: str
    status: Literal["complete", "running", "failed", "unreadable"]
    files: int
    bytes: int
    problems: tuple[str, ...]  # of its own files
    remarks: tuple[str, ...]  # nothing of its own: inputs that are gone or changed, files that nobody listed

    @property
    def is_sound(self) -> bool:
        """Every file is what was written."""
        return not self.problems


def verify(root: Path, ids: Sequence[str], progress: Progress) -> Iterator[Verdict]:
    """Verdicts in the order of `ids`. Of an artifact that is being written only the manifest counts."""
    found = [(each, _manifest(root, each)) for each in ids]
    total = sum(_size(manifest) for _, manifest in found if isinstance(manifest, Manifest))
    with progress.task("verify [MB]", total // _UNIT) as task, ThreadPoolExecutor(_THREADS) as threads:
        done = 0
        for each, manifest in found:
            if isinstance(manifest, str):
                yield Verdict(each, "unreadable", 0, 0, (manifest,), ())
                continue
            is_edited = config_sha256(manifest.config) != manifest.config_sha256
            directory, problems = artifact_path(root, each), [EDITED] if is_edited else []
            results = threads.map(partial(problem, directory), manifest.files)
            for file, found_wrong in zip(manifest.files, results, strict=True):
                problems += [found_wrong] if found_wrong else []
                task.advance((done + file.bytes) // _UNIT - done // _UNIT)
                done += file.bytes
            foreign, others = ([], []) if manifest.status == "running" else unlisted(directory, manifest)
            problems += [f"{name} is in no manifest" for name in foreign]
            remarks = (*(f"{name} is in no manifest" for name in others), *_inputs(root, manifest))
            yield Verdict(each, manifest.status, len(manifest.files), _size(manifest), tuple(problems), remarks)


def _size(manifest: Manifest) -> int:
    return sum(file.bytes for file in manifest.files)


def _manifest(root: Path, artifact_id: str) -> Manifest | str:
    try:
        return load(root, artifact_id)
    except PipelineError as error:
        return str(error)


def _inputs(root: Path, manifest: Manifest) -> list[str]:
    remarks = []
    for reference in manifest.inputs:
        try:
            now = manifest_sha256(artifact_path(root, reference.id))
        except (OSError, PipelineError):  # gone, or named as nothing can be
            remarks.append(f"its input {reference.id} is gone")
            continue
        if now != reference.manifest_sha256:
            remarks.append(f"its input {reference.id} is another one by now")
    return remarks
