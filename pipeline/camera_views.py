"""What the estimator sees under each misalignment of a study: one frame, re-rendered (the paper's Fig. 3)."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pyarrow.parquet as pq
from PIL import Image

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.store import Store
from pipeline.matrix import angle_name
from schemas.datasets import FrameRef
from schemas.errors import PipelineError
from schemas.manifest import Manifest

ENLARGED = 320
"""Width and height [pixels] of a view, whatever the dataset's: its pixels are to be seen."""


def write_camera_views(store: Store, runs: Sequence[Manifest], figures: Path) -> None:
    """Write figures/camera-KINDDEG.png for every misalignment among `runs`; none where no run had a camera.

    A report is worth having without them: where the dataset is gone or there is no OpenGL, they are left out.
    """
    seeing = [run for run in runs if run.config.get("estimator")]
    cameras = sorted(
        {(run.config["run"]["misalignment_kind"], run.config["run"]["misalignment_deg"]) for run in seeing}
    )
    if not cameras:
        return
    with suppress(PipelineError):
        estimator = load_complete(store.root, f"estimators/{seeing[0].config['estimator']}")
        dataset = store.path(estimator.inputs[0].id)
        load_complete(store.root, estimator.inputs[0].id)
        figures.mkdir(exist_ok=True)
        _write_views(dataset, cameras, figures)


def _write_views(dataset: Path, cameras: Sequence[tuple[str, float]], figures: Path) -> None:
    from stages.collect.rerender import make_rerender

    rerender, frame = make_rerender(dataset), _first_test_frame(dataset)
    for kind, degrees in cameras:
        view = Image.fromarray(next(iter(rerender([frame], kind, degrees))))
        view.resize((ENLARGED, ENLARGED), Image.Resampling.NEAREST).save(
            figures / f"camera-{kind}{angle_name(degrees)}.png"
        )


def _first_test_frame(dataset: Path) -> FrameRef:
    frames = pq.read_table(
        dataset / "frames.parquet", columns=["file", "episode", "step", "time_ns", "split"]
    ).to_pylist()
    frame = next((frame for frame in frames if frame["split"] == "test"), frames[0])
    return FrameRef(frame["file"], frame["episode"], frame["step"], frame["time_ns"])
