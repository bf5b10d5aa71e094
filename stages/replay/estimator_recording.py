"""Rerun recording (.rrd) of an estimator's test: its worst, median and best frames, and all errors on the table."""

from pathlib import Path

import numpy as np
import rerun as rr

from rerun_blueprints.perception import perception_blueprint
from schemas import entities
from schemas.manifest import read_manifest
from stages.replay.predictions import Frame, Predictions, load_frames, load_predictions, select
from stages.replay.projection import cube_edges, in_image
from stages.replay.recording_file import recording_file
from stages.replay.scene_log import log_table, xyzw
from stages.sim.scene import CUBE_HALF_SIZE

_FRAMES_EACH = 12  # worst, median, best
_GROUP_COLOURS = (entities.TRUE_COLOUR, entities.NEUTRAL_COLOUR, entities.ERROR_COLOUR)  # best, median, worst
_BINS = 40


def record_estimator(estimator: Path, dataset: Path, save: Path) -> int:
    """Write a recording of `estimator`'s test on frames of `dataset` to `save`. Returns the number of frames shown.

    Raises:
        ArtifactError: the estimator, its predictions or the dataset's frames are missing or damaged.
        MachineError: there is no space.
    """
    manifest = read_manifest(estimator)
    predictions, means = load_predictions(estimator)
    groups = select(predictions.error, _FRAMES_EACH)
    rows = np.concatenate(list(groups.values()))
    names = [name for name, of_group in groups.items() for _ in of_group]
    frames = load_frames(dataset, predictions.episode[rows], predictions.step[rows])
    with recording_file(f"{manifest.name} test frames", save, perception_blueprint()) as recording:
        _log_test(recording, predictions)
        about = _description(manifest.name, dataset.name, predictions, means)
        recording.log(entities.DESCRIPTION, rr.TextDocument(about, media_type="text/markdown"), static=True)
        _log_styles(recording)
        for rank, (row, name, frame) in enumerate(zip(rows, names, frames, strict=True)):
            recording.set_time(entities.RANK, sequence=rank)
            _log_frame(recording, frame, predictions.estimated[row])
            recording.log(entities.FRAME_ERROR, rr.Scalars(1000 * predictions.error[row]))
            if rank == 0 or names[rank - 1] != name:
                recording.log(entities.FRAME_GROUP, rr.StateChange(state=name))
    return len(rows)


def _log_test(recording: rr.RecordingStream, predictions: Predictions) -> None:
    """The whole test split: true positions, and a line from each to its estimate."""
    log_table(recording)
    world, thin = rr.CoordinateFrame(entities.WORLD), rr.Radius.ui_points(0.8)
    points = rr.Points3D(predictions.true, colors=entities.TRUE_COLOUR, radii=rr.Radius.ui_points(2.5))
    recording.log(entities.TEST_TRUE, world, points, static=True)
    strips = np.stack([predictions.true, predictions.estimated], axis=1)
    lines = rr.LineStrips3D(list(strips), colors=entities.ERROR_COLOUR, radii=thin)
    recording.log(entities.TEST_ERRORS, world, lines, static=True)
    counts, edges = np.histogram(1000 * predictions.error, bins=_BINS)  # [mm]
    bars = rr.BarChart(counts, abscissa=edges[:-1], widths=np.diff(edges), color=entities.ESTIMATED_COLOUR)
    recording.log(entities.ERROR_HISTOGRAM, bars, static=True)


def _log_styles(recording: rr.RecordingStream) -> None:
    groups = rr.StateConfiguration(values=["best", "median", "worst"], colors=_GROUP_COLOURS)
    recording.log(entities.FRAME_GROUP, groups, static=True)
    line = rr.SeriesLines(names="error of the frame [mm]", colors=entities.ERROR_COLOUR, widths=2.0)
    recording.log(entities.FRAME_ERROR, line, static=True)


def _log_frame(recording: rr.RecordingStream, frame: Frame, estimated: np.ndarray) -> None:
    camera = rr.Transform3D(
        translation=frame.camera.position,
        quaternion=xyzw(frame.camera.quaternion[None])[0],
        child_frame=entities.CAMERA,
        parent_frame=entities.WORLD,
    )
    recording.log(entities.TRANSFORMS, camera)
    pinhole = rr.Pinhole(
        image_from_camera=frame.intrinsics.matrix,
        resolution=[frame.intrinsics.size] * 2,
        parent_frame=entities.CAMERA,
        child_frame=entities.IMAGE_PLANE,
        image_plane_distance=0.2,
        color=entities.NEUTRAL_COLOUR,
    )
    recording.log(entities.CALIBRATION, pinhole)
    plane = rr.CoordinateFrame(entities.IMAGE_PLANE)
    recording.log(entities.IMAGE, plane, rr.EncodedImage(contents=frame.image, media_type=frame.media_type))
    _log_cubes(recording, frame, estimated, plane)


def _log_cubes(recording: rr.RecordingStream, frame: Frame, estimated: np.ndarray, plane: rr.CoordinateFrame) -> None:
    """Both cubes and the error between them, in the image and in the world."""
    world, turn = rr.CoordinateFrame(entities.WORLD), frame.cube_quaternion[None]  # the estimate has none of its own
    cubes = {
        (entities.CUBE_TRUE, entities.IMAGE_CUBE_TRUE): (frame.cube_position, entities.TRUE_COLOUR),
        (entities.CUBE_EST, entities.IMAGE_CUBE_EST): (estimated.astype(float), entities.ESTIMATED_COLOUR),
    }
    for (in_world, in_picture), (position, colour) in cubes.items():
        edges = cube_edges(position[None], turn, frame.camera, frame.intrinsics)
        recording.log(in_picture, plane, rr.LineStrips2D(edges, colors=colour, radii=rr.Radius.ui_points(1.5)))
        half = [[CUBE_HALF_SIZE] * 3]
        box = rr.Boxes3D(centers=[position], half_sizes=half, quaternions=xyzw(turn), colors=colour)
        recording.log(in_world, world, box)
    ends = np.stack([frame.cube_position, estimated])[None]  # (1, 2, 3)
    colour, radius = entities.ERROR_COLOUR, rr.Radius.ui_points(2)
    line = rr.LineStrips2D(in_image(ends, frame.camera, frame.intrinsics), colors=colour, radii=radius)
    recording.log(entities.IMAGE_ERROR, plane, line)
    recording.log(entities.CUBE_ERROR, world, rr.LineStrips3D(ends, colors=colour, radii=radius))


def _description(name: str, dataset: str, predictions: Predictions, means: dict[str, float]) -> str:
    error, bias = predictions.error, (predictions.estimated - predictions.true).mean(axis=0)
    rows = {
        "mean error": f"{100 * error.mean():.2f} cm",
        "median error": f"{100 * np.median(error):.2f} cm",
        "95th percentile": f"{100 * np.percentile(error, 95):.2f} cm",
        "bias x, y, z": ", ".join(f"{1000 * value:+.1f}" for value in bias) + " mm",
        **{f"mean error, {case}": f"{100 * mean:.2f} cm" for case, mean in means.items() if case != "as recorded"},
    }
    return "\n".join(
        [
            f"# Estimator {name}",
            f"{len(predictions)} test frames of dataset {dataset}; the {_FRAMES_EACH} worst, median and best are shown",
            "\n| | |\n|---|---|",
            *(f"| {label} | {value} |" for label, value in rows.items()),
        ]
    )
