"""export → a file or directory outside the data root's artifacts, for other projects' programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.store import Store
from pipeline.machine import require_gl, require_sim
from schemas.progress import Progress

if TYPE_CHECKING:
    from stages.replay.formats.export import Format


@dataclass(frozen=True)
class Wish:
    """What is asked for of an artifact."""

    form: "Format"
    split: str | None  # None: all
    episodes: int | None  # the first ones; None: all
    images: bool | None  # None: where they need not be rendered


def export(store: Store, artifact_id: str, wish: Wish, target: Path, progress: Progress) -> dict[str, Any]:
    """Write a run, new labels or a dataset, verified first; what was written.

    Raises:
        ArtifactError: the artifact is missing, unfinished or damaged.
        ConfigError: the target is there already, or nothing of the artifact is asked for.
        MachineError: there is no OpenGL to render with, or no space.
    """
    is_dataset = artifact_id.startswith("datasets/")
    images = is_dataset if wish.images is None else wish.images
    load_complete(store.root, artifact_id)
    require_sim()
    if images and not is_dataset:
        require_gl()
    from stages.replay.formats.export import check_absent, open_source
    from stages.replay.formats.export import export as write

    check_absent(target)
    source = open_source(store.path(artifact_id), wish.form, wish.split, wish.episodes, images)
    return write(source, wish.form, target, progress)
