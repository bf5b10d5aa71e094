"""A tiny dataset on disk whose images can be understood: a red square on grey, at the position it is the target of."""

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap_protobuf.writer import Writer
from PIL import Image

from schemas.datasets import FrameRef
from schemas.files import write_parquet
from schemas.tables import FRAMES

SIZE = 32
CAMERA = {"image_size": SIZE, "position": [0.9, 0.0, 1.5], "target": [0.0, 0.0, 0.85], "fovy": 45.0}
PERIOD_NS = 50_000_000


def draw(position: np.ndarray, size: int = SIZE) -> np.ndarray:
    """Image (size, size, 3): x, y in [-0.15, 0.15] m: column and row, z: brightness."""
    image = np.full((size, size, 3), 90, np.uint8)
    column, row = np.rint((position[:2] / 0.3 + 0.5) * (size - 8)).astype(int)
    image[row : row + 8, column : column + 8] = (np.rint(155 + (position[2] - 0.8) * 1000), 20, 20)
    return image


def positions(episode: int, frames: int) -> np.ndarray:
    """Cube positions (frames, 3) [m] of an episode."""
    rng = np.random.default_rng([7, episode])
    return rng.uniform([-0.15, -0.15, 0.8], [0.15, 0.15, 0.9], (frames, 3))


def write_episode(path: Path, cubes: np.ndarray, image_format: str = "PNG") -> None:
    """MCAP file of the images of `cubes` (n, 3) at 0, 50, 100 … ms, among messages of another topic."""
    with path.open("wb") as file, Writer(file) as writer:
        for step, cube in enumerate(cubes):
            buffer = io.BytesIO()
            Image.fromarray(draw(cube)).save(buffer, image_format)
            message = CompressedImage(frame_id="camera", data=buffer.getvalue(), format=image_format.lower())
            time_ns = step * PERIOD_NS
            writer.write_message("/camera/image", message, time_ns, time_ns)
            writer.write_message("/other", CompressedImage(data=b"not an image"), time_ns, time_ns)


def write_manifest(directory: Path, **changes: object) -> None:
    manifest = {
        "id": "datasets/tiny",
        "stage": "collect",
        "name": "tiny",
        "schema_version": 1,
        "status": "complete",
        "created_at": "2025-01-01T00:00:00Z",
        "config": {"camera": CAMERA},
        "config_sha256": "",
        "inputs": [],
        "code": {"version": "0", "git_commit": None, "dirty": None},
        "environment": {"python": "", "platform": "", "cpu": "", "gpu": None, "gl_renderer": None, "packages": {}},
        "files": [],
        "summary": {},
    }
    (directory / "manifest.json").write_text(json.dumps(manifest | changes))


def frame_rows(episode: int, split: str, cubes: np.ndarray) -> list[dict[str, object]]:
    rows = []
    for step, cube in enumerate(cubes):
        row = {"dataset": "tiny", "episode": episode, "step": step, "time_ns": step * PERIOD_NS, "split": split}
        row |= {"file": f"episodes/episode-{episode:06d}.mcap", "behaviour": "random"}
        row |= {f"cube_{axis}": value for axis, value in zip("xyz", cube, strict=True)}
        row |= dict.fromkeys(("camera_x", "camera_y", "camera_z", "camera_qx", "camera_qy", "camera_qz"), 0.0)
        rows.append(row | {"camera_qw": 1.0})
    return rows


def write_dataset(directory: Path, splits: Sequence[str], frames: int) -> Path:
    """A dataset with one episode of `frames` frames for each entry of `splits`."""
    (directory / "episodes").mkdir(parents=True)
    write_manifest(directory)
    rows = []
    for episode, split in enumerate(splits):
        cubes = positions(episode, frames)
        write_episode(directory / "episodes" / f"episode-{episode:06d}.mcap", cubes)
        rows += frame_rows(episode, split, cubes)
    write_parquet(pa.Table.from_pylist(rows, schema=FRAMES), directory / "frames.parquet")
    return directory


def shifted(refs: Sequence[FrameRef], kind: str, degrees: float) -> Iterator[np.ndarray]:
    """Stands for re-rendering: `degrees` pixels to the right for pan; an orbit changes nothing."""
    for ref in refs:
        frames = 1 + max(other.step for other in refs if other.episode == ref.episode)
        image = draw(positions(ref.episode, frames)[ref.step])
        yield np.roll(image, int(degrees), axis=1) if kind == "pan" else image
