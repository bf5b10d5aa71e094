"""Finding and verifying artifacts that are to be read."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.artifacts.manifests import manifest_sha256, read_manifest
from pipeline.artifacts.names import STAGE_OF, artifact_path, depth, existing_ids, split_id
from schemas.errors import ArtifactError, ConfigError, PipelineError, listed
from schemas.integrity import check_config, check_file, file_sha256, unlisted
from schemas.manifest import InputRef, Manifest

HASHED = (".parquet", ".json", ".safetensors", ".mcap")
"""Files verified by content each time they are an input: two episodes that changed places have the right sizes, and
checksums of their own that hold."""


def load_complete(root: Path, artifact_id: str) -> Manifest:
    """Manifest of an input that is complete, its files verified.

    Raises:
        ArtifactError: missing (lists what exists), not finished, damaged, foreign or of a newer schema version.
    """
    manifest = load(root, artifact_id)
    path = artifact_path(root, artifact_id)
    if manifest.status != "complete":
        state = "is not finished" if manifest.status == "running" else "failed"
        raise ArtifactError(
            f"{artifact_id} {state}: resume it with `pipeline {manifest.stage} … --resume`", awaited=True
        )
    _check_files(path, manifest)
    return manifest


def load_shown(root: Path, artifact_id: str) -> Manifest:
    """Manifest of an artifact that is to be looked at, in any state; verified unless it is still being written."""
    manifest = load(root, artifact_id)
    if manifest.status != "running":
        _check_files(artifact_path(root, artifact_id), manifest)
    return manifest


def _check_files(directory: Path, manifest: Manifest) -> None:
    check_config(manifest)
    if foreign := unlisted(directory, manifest)[0]:
        raise ArtifactError(f"{manifest.id} holds {foreign[0]}, which its manifest does not know: remove it")
    for file in manifest.files:
        check_file(directory, manifest.id, file, file_sha256 if file.path.endswith(HASHED) else None)


def load(root: Path, artifact_id: str) -> Manifest:
    """Manifest of an artifact in any state; ArtifactError lists what exists when it does not."""
    kind, _ = split_id(artifact_id)
    path = artifact_path(root, artifact_id)
    if not path.exists():
        there = ", ".join(existing_ids(root, kind)) or f"no {kind}"
        raise ArtifactError(
            f"{artifact_id} does not exist under {root}; there: {there}. Make it: `{make(artifact_id)}`", awaited=True
        )
    return read_manifest(path, artifact_id)


def make(artifact_id: str) -> str:
    """Command that makes an artifact of this id."""
    kind, names = split_id(artifact_id)
    more = " RUN --scheme …" if kind == "relabels" else ""
    return f"pipeline {STAGE_OF[kind]}{more} --name {names[0]}"


def input_ref(root: Path, artifact_id: str) -> InputRef:
    """Pin an input by the hash of its manifest."""
    return InputRef(id=artifact_id, manifest_sha256=manifest_sha256(artifact_path(root, artifact_id)))


def resolve(root: Path, reference: str, kinds: tuple[str, ...] = tuple(STAGE_OF)) -> str:
    """Id that a user's reference means: a whole id, a path under the data root, or an unambiguous bare name."""
    text = reference.removeprefix(f"{root}/").strip("/")
    head, *rest = text.split("/")
    if head in kinds and len(rest) == depth(head):
        return text
    candidates = [each for kind in kinds for each in existing_ids(root, kind) if _means(text, each)]
    if len(candidates) == 1:
        return candidates[0]
    if candidates:
        raise ConfigError(f"{reference!r} is ambiguous, it may mean: {', '.join(candidates)}")
    there = listed(text, (each for kind in kinds for each in existing_ids(root, kind))) or "nothing"
    raise ArtifactError(f"no artifact {reference!r} under {root}; there: {there}")


def _means(text: str, artifact_id: str) -> bool:
    """A reference means NAME, NAME/CELL, CELL or, for every cell of a group, KIND/NAME."""
    kind, *names = artifact_id.split("/")
    return text in ("/".join(names), names[0], names[-1]) or (depth(kind) == 2 and text == f"{kind}/{names[0]}")


@dataclass(frozen=True)
class Lineage:
    """An artifact and what it was made from, back to the first input."""

    id: str
    manifest: Manifest | None  # None when it is gone
    changed: bool
    """It is no longer the artifact that was the input: its manifest has another hash."""
    inputs: tuple["Lineage", ...]


def lineage(root: Path, artifact_id: str, pinned: str | None = None) -> Lineage:
    """Follow the inputs recorded in the manifests.

    What was made again since is not followed: its inputs are not those of the artifact that was the input. So no
    manifests can send it in a circle, for each would have to hold the other's hash.
    """
    try:
        manifest = load(root, artifact_id)
    except PipelineError:
        if pinned is None:
            raise
        return Lineage(artifact_id, None, True, ())
    changed = pinned is not None and pinned != manifest_sha256(artifact_path(root, artifact_id))
    followed = [] if changed else manifest.inputs
    inputs = tuple(lineage(root, ref.id, ref.manifest_sha256) for ref in followed)
    return Lineage(artifact_id, manifest, changed, inputs)
