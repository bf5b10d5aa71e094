"""Images as they are stored in episode files and recordings."""

import io
import struct
import zlib
from collections.abc import Sequence
from typing import Literal

import numpy as np
from PIL import Image

ImageFormat = Literal["png", "jpeg"]

_PNG_LEVEL = 1  # half the time of the default for a tenth more bytes
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_RGB = 2  # PNG's colour type
_JPEG_QUALITY = 95
_FALLING_QUALITY = (95, 85, 70, 50, 30, 15)


def encode(image: np.ndarray, image_format: ImageFormat, *, chunked: bool = False) -> bytes:
    """An image (h, w, 3) uint8 RGB as PNG, which keeps it exactly, or as JPEG.

    `chunked`: it goes into a chunk that is compressed as a whole, so the PNG itself is not. That takes a tenth of the
    time to write and less to read, and a quarter of the bytes, because a chunk's pictures have their background in
    common.
    """
    if image_format == "png" and chunked:
        return _stored_png(image)
    buffer = io.BytesIO()
    if image_format == "png":
        Image.fromarray(image).save(buffer, "PNG", compress_level=_PNG_LEVEL)
    else:
        return _jpeg(image, _JPEG_QUALITY)
    return buffer.getvalue()


def encode_within(images: Sequence[np.ndarray], image_format: ImageFormat, budget: int) -> list[bytes]:
    """Images of one scene, in `budget` bytes together where JPEG can: its quality is the best at which the first fits.

    PNG is exact, whatever it takes.
    """
    if image_format == "png" or not images:
        return [encode(image, image_format) for image in images]
    share = budget / len(images)
    quality = next((each for each in _FALLING_QUALITY if len(_jpeg(images[0], each)) <= share), _FALLING_QUALITY[-1])
    return [_jpeg(image, quality) for image in images]


def _jpeg(image: np.ndarray, quality: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def _stored_png(image: np.ndarray) -> bytes:
    """A PNG whose rows are neither filtered nor compressed."""
    height, width, channels = image.shape
    rows = np.zeros((height, 1 + channels * width), np.uint8)  # the first byte of a row names its filter: 0, none
    rows[:, 1:] = image.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, _RGB, 0, 0, 0)  # 8 bits a channel, not interlaced
    parts = (
        _png_chunk(b"IHDR", header),
        _png_chunk(b"IDAT", zlib.compress(rows.tobytes(), level=0)),
        _png_chunk(b"IEND", b""),
    )
    return _PNG_SIGNATURE + b"".join(parts)


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))
