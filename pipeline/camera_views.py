"""What the camera sees of one scene, as calibrated and turned (the paper's Fig. 3): large, for people to look at."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyarrow.parquet as pq
from PIL import Image

from pipeline.artifacts.inputs import load, load_complete
from pipeline.artifacts.store import Store
from pipeline.machine import require_sim
from schemas.errors import ArtifactError, PipelineError
from schemas.mcap_files import read_messages
from schemas.mcap_topics import SIM_STATE
from schemas.tables import FRAMES
from stages.sim.config import MisalignmentKind

SIZE = 320
"""Width and height [pixels] of a view, whatever the estimator's images have."""

View = tuple[str, MisalignmentKind, float]
"""Title, kind of misalignment, degrees."""


def write_camera_views(store: Store, estimators: Sequence[str], figures: Path) -> None:
    """Write figures/camera-TITLE.png of the calibrated camera and of each turn the first estimator was tested under.

    A report is worth having without them: where the dataset is gone or there is no OpenGL, they are left out.
    """
    if not estimators:
        return
    with suppress(PipelineError):
        estimator = load(store.root, estimators[0])
        dataset = estimator.inputs[0].id
        config = load_complete(store.root, dataset).config
        require_sim()
        figures.mkdir(exist_ok=True)
        _write_views(store.path(dataset), config, views(estimator.config["perception"]["test_misalignments"]), figures)


def views(tested: Sequence[float]) -> list[View]:
    """The calibrated camera, then each kind of misalignment at the tested angles [degrees]."""
    turned = [(kind, degrees) for kind in sorted(get_args(MisalignmentKind)) for degrees in sorted(tested) if degrees]
    return [("0°", "pan", 0.0), *((f"{kind} {degrees:g}°", kind, degrees) for kind, degrees in turned)]


def _write_views(dataset: Path, config: dict[str, Any], wanted: Sequence[View], figures: Path) -> None:
    from stages.collect.config import CollectStageConfig
    from stages.sim.camera import misaligned, nominal_pose
    from stages.sim.renderer import Renderer
    from stages.sim.scene import build_scene

    stage = CollectStageConfig.model_validate({name: config[name] for name in CollectStageConfig.model_fields})
    nominal, pivot, qpos = nominal_pose(stage.camera), np.array(stage.camera.target), _test_scene(dataset)
    with Renderer(build_scene(stage.world), SIZE, stage.camera.fovy) as renderer:
        for title, kind, degrees in wanted:
            image = renderer.render(qpos, misaligned(nominal, kind, degrees, pivot))
            Image.fromarray(image).save(figures / f"camera-{title}.png")


def _test_scene(dataset: Path) -> np.ndarray:
    """Generalised positions (nq,) of the first test frame, or of the first frame where none is for testing."""
    frames = pq.read_table(dataset / "frames.parquet", schema=FRAMES, columns=["file", "time_ns", "split"]).to_pylist()
    frame = next((frame for frame in frames if frame["split"] == "test"), frames[0])
    for _, time_ns, message in read_messages(dataset / frame["file"], SIM_STATE):
        if time_ns == frame["time_ns"]:
            return np.array(message.qpos)
    raise ArtifactError(f"{dataset / frame['file']} has no {SIM_STATE} at {frame['time_ns']} ns: collect it again")
