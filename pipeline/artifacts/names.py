"""Names of artifacts and where they live under the data root."""

import re
from pathlib import Path

from schemas.errors import ArtifactError, ConfigError, unknown_choice
from schemas.files import leads_out
from schemas.manifest import MANIFEST, Stage

STAGE_OF: dict[str, Stage] = {
    "datasets": "collect",
    "estimators": "train-perception",
    "runs": "train-policy",
    "relabels": "relabel",
    "reports": "analyze",
}
"""Kind of artifact → the stage that makes it."""

MAX_LENGTH = 100
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def check_name(name: str) -> str:
    """Return `name` if it may name an artifact; ConfigError otherwise."""
    if not _NAME.fullmatch(name) or ".." in name or len(name) > MAX_LENGTH:
        raise ConfigError(
            f"name {name!r} cannot be used: letters, digits, '.', '_' and '-' only, beginning with a letter or digit, "
            f"no '..', at most {MAX_LENGTH} characters"
        )
    return name


def split_id(artifact_id: str) -> tuple[str, tuple[str, ...]]:
    """Kind and checked names of an id: `runs/demo/CELL` → ("runs", ("demo", "CELL"))."""
    kind, *names = artifact_id.split("/")
    if kind not in STAGE_OF:
        raise ConfigError(unknown_choice("kind of artifact", kind, STAGE_OF))
    if len(names) != depth(kind):
        form = f"{kind}/NAME/CELL" if depth(kind) == 2 else f"{kind}/NAME"
        raise ConfigError(f"{artifact_id!r} does not name one artifact; the form is {form}")
    return kind, tuple(check_name(name) for name in names)


def depth(kind: str) -> int:
    """How many names identify an artifact of this kind: a run, or its new labels, has two, NAME/CELL."""
    return 2 if kind in ("runs", "relabels") else 1


def artifact_path(root: Path, artifact_id: str) -> Path:
    """Directory of an artifact.

    Raises:
        ConfigError: the id can be no artifact's.
        ArtifactError: a link there leads out of the data root, where nothing is read and nothing written.
    """
    kind, names = split_id(artifact_id)
    path = root.joinpath(kind, *names)
    if leads_out(path / MANIFEST, root):
        raise ArtifactError(f"{path} leads out of the data root {root}: put the artifact itself there")
    return path


def existing_ids(root: Path, kind: str) -> list[str]:
    """Ids of this kind that have a manifest, sorted; half-built temporary directories (hidden) are not among them."""
    pattern = "/".join(["*"] * depth(kind)) + "/manifest.json"
    found = (path.parent.relative_to(root) for path in (root / kind).glob(pattern))
    return sorted(path.as_posix() for path in found if not any(part.startswith(".") for part in path.parts))
