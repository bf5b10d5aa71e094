"""LeRobot's numbered files: Parquet and MP4 that hold many episodes each, up to a size."""

from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stages.sim.scene import CONTROL_FREQUENCY

FILES_IN_CHUNK = 1000
DATA_MB, VIDEO_MB = 100, 200  # LeRobot's own limits of a file
CODEC = "h264"
_ENCODER = "libx264"
_OPTIONS = {"crf": "18", "g": "2", "bf": "0"}  # a key frame every other frame: frames are read in any order


class Place(NamedTuple):
    """Which file."""

    chunk: int
    file: int

    @classmethod
    def of(cls, index: int) -> "Place":
        """The file with this number over all chunks."""
        return cls(*divmod(index, FILES_IN_CHUNK))

    def path(self, directory: Path, ending: str) -> Path:
        """Its path; the chunk's directory is made."""
        path = directory / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}{ending}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


class TableFiles:
    """Tables one after the other; an episode's rows stay together."""

    def __init__(self, directory: Path) -> None:
        self._directory, self._index = directory, 0
        self._path: Path | None = None
        self._writer: pq.ParquetWriter | None = None

    def add(self, table: pa.Table) -> Place:
        """Write a table; which file it is in."""
        if self._path and self._path.stat().st_size > DATA_MB * 2**20:
            self.close()
            self._index += 1
        if self._writer is None:
            self._path = Place.of(self._index).path(self._directory, ".parquet")
            self._writer = pq.ParquetWriter(self._path, table.schema)
        self._writer.write_table(table)
        return Place.of(self._index)

    def close(self) -> None:
        """Close the present file."""
        writer, self._writer, self._path = self._writer, None, None  # one that cannot be closed is not tried again
        if writer:
            writer.close()


class VideoFiles:
    """Frames one after the other, at the control frequency."""

    def __init__(self, directory: Path) -> None:
        self._directory, self._index = directory, 0
        self._frames = self._bytes = 0  # of the present file
        self._container: Any = None  # av's are made by functions with many overloads
        self._stream: Any = None

    def add(self, frames: np.ndarray) -> tuple[Place, float, float]:
        """Write frames (n, H, W, 3) uint8; which file they are in, from when to when [s]."""
        if self._bytes > VIDEO_MB * 2**20:
            self.close()
            self._index += 1
        if self._container is None:
            self._open(*frames.shape[1:3])
        first = self._frames
        for frame in frames:
            self._write(self._container, av.VideoFrame.from_ndarray(frame, format="rgb24"))
        self._frames += len(frames)
        return Place.of(self._index), first / CONTROL_FREQUENCY, self._frames / CONTROL_FREQUENCY

    def close(self) -> None:
        """Finish the present file."""
        container, self._container = self._container, None  # one that cannot be closed is not tried again
        self._frames = self._bytes = 0
        if container:
            with closing(container):
                self._write(container, None)

    def _write(self, container: Any, frame: av.VideoFrame | None) -> None:
        """Encode a frame; None: what the encoder still holds back."""
        for packet in self._stream.encode(frame):
            self._bytes += packet.size
            container.mux(packet)

    def _open(self, height: int, width: int) -> None:
        path = Place.of(self._index).path(self._directory, ".mp4")
        self._container = av.open(str(path), "w", format="mp4")
        self._stream = self._container.add_stream(_ENCODER, rate=Fraction(CONTROL_FREQUENCY), options=_OPTIONS)
        self._stream.height, self._stream.width = height, width
        self._stream.pix_fmt = pixel_format(height, width)


def pixel_format(height: int, width: int) -> str:
    """4:2:0, which every reader takes; it needs even lengths."""
    return "yuv444p" if height % 2 or width % 2 else "yuv420p"
