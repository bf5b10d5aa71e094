"""An estimator's test predictions, and the frames of its dataset that they are of."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from schemas import mcap_topics
from schemas.errors import ArtifactError
from schemas.files import read_parquet
from schemas.mcap_files import read_messages
from schemas.tables import FRAMES, PREDICTIONS
from stages.replay.parquet import check_schema
from stages.sim.camera import CameraPose, Intrinsics

_TOPICS = (mcap_topics.CAMERA_IMAGE, mcap_topics.CAMERA_CALIBRATION, mcap_topics.TF, mcap_topics.CUBE_POSE)


@dataclass(frozen=True)
class Predictions:
    """Of n frames of the test split."""

    episode: np.ndarray  # (n,)
    step: np.ndarray  # (n,)
    true: np.ndarray  # (n, 3) [m]
    estimated: np.ndarray  # (n, 3) [m]
    error: np.ndarray  # (n,) [m]

    def __len__(self) -> int:
        return len(self.error)


@dataclass(frozen=True)
class Frame:
    """A kept frame of a dataset with its ground truth."""

    image: bytes
    media_type: str
    camera: CameraPose
    intrinsics: Intrinsics
    cube_position: np.ndarray  # (3,) [m]
    cube_quaternion: np.ndarray  # (4,), (w, x, y, z)


def load_predictions(estimator: Path) -> tuple[Predictions, dict[str, float]]:
    """Predictions on the frames as recorded, and the mean error [m] of each misalignment by name ("pan 5°").

    Raises:
        ArtifactError: there are none, or they are damaged.
    """
    path = estimator / "predictions.parquet"
    table = read_parquet(path, missing=f"estimator {estimator.name} has no predictions yet")
    check_schema(table.schema, PREDICTIONS, path)
    kind = np.array(table["misalignment_kind"].to_pylist(), dtype=str)
    degrees, error = table["misalignment_deg"].to_numpy(), table["error"].to_numpy()
    if not (kind == "none").any():
        raise ArtifactError(f"{path} has no predictions on the frames as recorded")
    names = {
        (k, d): f"{k} {d:g}°" if k != "none" else "as recorded" for k, d in sorted(set(zip(kind, degrees, strict=True)))
    }
    means = {name: float(error[(kind == k) & (degrees == d)].mean()) for (k, d), name in names.items()}
    return _predictions(table.filter(pa.array(kind == "none"))), means


def _predictions(table: pa.Table) -> Predictions:
    def columns(prefix: str) -> np.ndarray:
        return np.stack([table[f"{prefix}_{axis}"].to_numpy() for axis in "xyz"], axis=1)

    return Predictions(
        table["episode"].to_numpy(),
        table["step"].to_numpy(),
        columns("cube_true"),
        columns("cube_est"),
        table["error"].to_numpy(),
    )


def select(error: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """Rows of the `count` worst, median and best frames, each from large error to small; no row twice."""
    order = np.argsort(-error, kind="stable")
    count = min(count, max(1, len(order) // 3))
    middle = max(count, (len(order) - count) // 2)
    groups = {
        "worst": order[:count],
        "median": order[middle : middle + count],
        "best": order[middle + count :][-count:],
    }
    return {name: rows for name, rows in groups.items() if len(rows)}


def load_frames(dataset: Path, episodes: np.ndarray, steps: np.ndarray) -> list[Frame]:
    """The frames at (episode, step), in that order; each file is read once.

    Raises:
        ArtifactError: the dataset lacks one of them, or is damaged.
    """
    wanted = list(zip(episodes.tolist(), steps.tolist(), strict=True))
    places = _places(dataset, set(wanted))
    found: dict[tuple[str, int], Frame] = {}
    for file in dict.fromkeys(file for file, _ in places.values()):
        times = {time for other, time in places.values() if other == file}
        for time, messages in _messages(dataset / file, times).items():
            found[file, time] = _frame(messages)
    missing = [key for key in wanted if places[key] not in found]
    if missing:
        raise ArtifactError(
            f"{dataset} lacks the frame of episode {missing[0][0]} step {missing[0][1]}: collect it again"
        )
    return [found[places[key]] for key in wanted]


def _places(dataset: Path, wanted: set[tuple[int, int]]) -> dict[tuple[int, int], tuple[str, int]]:
    """(episode, step) → (file, time [ns])."""
    path = dataset / "frames.parquet"
    table = read_parquet(path, missing=f"dataset {dataset.name} is gone or not complete")
    check_schema(table.schema, FRAMES, path)
    columns = (table[name].to_pylist() for name in ("episode", "step", "file", "time_ns"))
    places = {(e, s): (file, time) for e, s, file, time in zip(*columns, strict=True) if (e, s) in wanted}
    if missing := wanted - places.keys():
        raise ArtifactError(
            f"{path} has no frame of episode {min(missing)[0]} step {min(missing)[1]}: it is another dataset"
        )
    return places


def _messages(path: Path, times: set[int]) -> dict[int, dict[str, Any]]:
    kept: dict[int, dict[str, Any]] = {}
    for topic, time, message in read_messages(path, *_TOPICS):
        if time in times:
            kept.setdefault(time, {})[topic] = message
    return {time: messages for time, messages in kept.items() if len(messages) == len(_TOPICS)}


def _frame(messages: dict[str, Any]) -> Frame:
    image, calibration = messages[mcap_topics.CAMERA_IMAGE], messages[mcap_topics.CAMERA_CALIBRATION]
    pose = messages[mcap_topics.CUBE_POSE].pose
    return Frame(
        image=image.data,
        media_type=f"image/{image.format}",
        camera=CameraPose.from_quaternion(*mcap_topics.placement(messages[mcap_topics.TF], mcap_topics.CAMERA_FRAME)),
        intrinsics=Intrinsics(calibration.width, calibration.K[0]),
        cube_position=np.array([pose.position.x, pose.position.y, pose.position.z]),
        cube_quaternion=np.array([pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z]),
    )
