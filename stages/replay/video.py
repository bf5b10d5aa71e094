"""Frames as an MP4 that every browser and player opens: H.264, 4:2:0."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from stages.sim.scene import CONTROL_FREQUENCY

_MIN_SIZE = 512  # [pixels]; smaller frames are enlarged by whole pixels, for players blur what they enlarge
_QUALITY = "18"  # x264's constant rate factor: visually lossless


def write_mp4(frames: Sequence[np.ndarray], save: Path) -> None:
    """Write `frames`, each (H, W, 3) uint8, at the speed of simulation time; `save` is whole or absent."""
    factor = max(1, -(-_MIN_SIZE // len(frames[0])))
    temporary = save.with_name(f".{save.name}.tmp")
    try:
        with av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=Fraction(CONTROL_FREQUENCY), options={"crf": _QUALITY})
            stream.height, stream.width = (factor * length for length in frames[0].shape[:2])
            stream.pix_fmt = "yuv420p"
            for frame in frames:
                enlarged = frame.repeat(factor, axis=0).repeat(factor, axis=1)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(enlarged, format="rgb24")))
            container.mux(stream.encode())
        temporary.replace(save)
    finally:
        temporary.unlink(missing_ok=True)
