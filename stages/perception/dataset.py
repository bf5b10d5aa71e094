"""Frames of a dataset in memory: images out of the MCAP files that frames.parquet lists (SPEC §4)."""

import io
import os
import tempfile
from collections.abc import Iterator, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from PIL import Image

from schemas.datasets import FrameRef
from schemas.errors import ArtifactError, MachineError
from schemas.files import read_parquet
from schemas.manifest import MANIFEST, Manifest, read_manifest
from schemas.mcap_files import read_messages
from schemas.mcap_topics import CAMERA_IMAGE
from schemas.progress import Progress
from schemas.tables import FRAMES

SPLITS = ("train", "validation", "test")
MEMORY_LIMIT = 6 * 2**30
"""Bytes of images held in memory; more are held in a temporary file, mapped."""


@dataclass(frozen=True)
class Frames:
    """All frames of a dataset, in the order of `refs`."""

    dataset: str
    camera: dict[str, Any]  # the dataset's CameraConfig
    images: np.ndarray  # (n, h, w, 3) uint8 RGB
    positions: np.ndarray  # (n, 3) float64, the cube in the world frame [m]
    splits: np.ndarray  # (n,) of SPLITS
    refs: list[FrameRef]

    @property
    def image_size(self) -> int:
        """Pixels; images are square."""
        return int(self.images.shape[1])

    def indices(self, split: str) -> np.ndarray:
        """Rows of one split, ascending."""
        return np.flatnonzero(self.splits == split)


def load_frames(dataset: Path, cache: Path, progress: Progress, memory_limit: int = MEMORY_LIMIT) -> Frames:
    """Read every frame of the dataset in `dataset`; `cache` takes the temporary file when they exceed `memory_limit`.

    Raises ArtifactError, naming the file, when one is missing, damaged, foreign, or lacks a frame.
    """
    manifest = _dataset_manifest(dataset)
    table = _read_table(dataset / "frames.parquet")
    camera = manifest.config["camera"]
    size = camera["image_size"]
    images = _allocate((table.height, size, size, 3), cache, memory_limit)
    _fill(images, table, dataset, progress)
    return Frames(
        dataset=manifest.name,
        camera=camera,
        images=images,
        positions=table.select("cube_x", "cube_y", "cube_z").to_numpy(),
        splits=table["split"].to_numpy(),
        refs=[FrameRef(*row) for row in table.select("file", "episode", "step", "time_ns").iter_rows()],
    )


def _fill(images: np.ndarray, table: pl.DataFrame, dataset: Path, progress: Progress) -> None:
    """Decode the image of every row of `table` into `images` (n, h, w, 3)."""
    with progress.task("load frames", table.height) as task:
        for (name,), rows in table.group_by("file", maintain_order=True):
            file = dataset / str(name)
            wanted = dict(zip(rows["time_ns"], rows["row"], strict=True))
            for time_ns, image in _read_images(file, wanted.keys(), images.shape[1]):
                images[wanted.pop(time_ns)] = image
                task.advance()
            if wanted:
                raise ArtifactError(f"{file}: no {CAMERA_IMAGE} at {min(wanted)} ns, though frames.parquet lists it")


def _dataset_manifest(dataset: Path) -> Manifest:
    manifest = read_manifest(dataset)
    if not isinstance(manifest.config.get("camera"), dict) or "image_size" not in manifest.config["camera"]:
        raise ArtifactError(f"{dataset / MANIFEST}: config.camera is missing; is it a dataset's manifest?")
    return manifest


def _read_table(file: Path) -> pl.DataFrame:
    stored = read_parquet(file)
    if missing := sorted(set(FRAMES.names) - set(stored.column_names)):
        raise ArtifactError(f"{file}: lacks columns {', '.join(missing)}")
    table = pl.DataFrame(pl.from_arrow(stored))
    table = table.with_columns(pl.col("file", "split").cast(pl.String)).with_row_index("row")
    _check_splits(table, file)
    return table


def _check_splits(table: pl.DataFrame, file: Path) -> None:
    empty = [split for split in SPLITS if split not in table["split"]]
    if empty:
        raise ArtifactError(f"{file}: no frames in split {', '.join(empty)}; collect more episodes")
    if table.group_by("episode").agg(pl.col("split").n_unique()).filter(pl.col("split") > 1).height:
        raise ArtifactError(f"{file}: an episode lies in two splits, so test frames would resemble training frames")


def _allocate(shape: tuple[int, ...], cache: Path, memory_limit: int) -> np.ndarray:
    size = int(np.prod(shape))
    if size <= memory_limit:
        return np.empty(shape, np.uint8)
    with tempfile.TemporaryFile(dir=cache) as file:  # the mapping outlives the name, and nothing is left behind
        try:
            os.posix_fallocate(file.fileno(), 0, size)  # a full disk would otherwise end the process (SIGBUS)
        except OSError as error:
            raise MachineError(
                f"{cache}: no room for {size / 1e9:.1f} GB of decoded images ({error.strerror})"
            ) from error
        return np.memmap(file, np.uint8, "r+", shape=shape)


def _read_images(file: Path, times: Set[int], size: int) -> Iterator[tuple[int, np.ndarray]]:
    """The camera's images at the log times `times` [ns], in one pass over the file."""
    for _, time_ns, message in read_messages(file, CAMERA_IMAGE):
        if time_ns not in times:
            continue
        try:
            image = np.asarray(Image.open(io.BytesIO(message.data)).convert("RGB"))  # (h, w, 3)
        except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises for damaged PNG and JPEG
            raise ArtifactError(f"{file}: the image at {time_ns} ns cannot be decoded; collect again") from error
        if image.shape != (size, size, 3):
            raise ArtifactError(f"{file}: the image at {time_ns} ns is {image.shape}, the camera's are {size} × {size}")
        yield time_ns, image
