"""Pictures keep every pixel, however they are encoded."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from schemas.images import encode


@pytest.mark.parametrize("chunked", [False, True])
@given(height=st.integers(1, 200), width=st.integers(1, 200), seed=st.integers(0, 9))
def test_png_is_lossless(chunked: bool, height: int, width: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)
    opened = Image.open(io.BytesIO(encode(image, "png", chunked=chunked)))
    assert (opened.format, opened.mode) == ("PNG", "RGB")
    assert np.array_equal(np.asarray(opened), image)


def test_a_damaged_stored_png_is_noticed() -> None:
    data = bytearray(encode(np.zeros((64, 64, 3), np.uint8), "png", chunked=True))
    data[1000] ^= 1
    with pytest.raises((OSError, SyntaxError)):
        Image.open(io.BytesIO(data)).load()


def test_jpeg_is_near() -> None:
    image = np.full((64, 64, 3), 90, np.uint8)
    opened = np.asarray(Image.open(io.BytesIO(encode(image, "jpeg", chunked=True)))).astype(int)
    assert np.abs(opened - image).max() <= 2
