"""The paper's Fig. 3: what the camera sees as calibrated and turned, as one picture."""

import base64
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from xml.sax.saxutils import escape

from PIL import Image

from stages.analyze.figures import export, theme

ID = "fig3-cameras"
TITLE = "The camera's view, as calibrated and turned"
CAPTION = "The fixed camera's view of the same scene as calibrated and turned."
_SIDE, _GAP, _HEAD = 200, 16, 44  # pixels
_COLUMNS = 3
_QUALITY = 90


def pictures(figures: Path) -> list[Path]:
    """The views there are, by kind of misalignment and angle: `camera-0°`, `camera-orbit 5°`, `camera-orbit 10°`, …"""
    return sorted(figures.glob("camera-*.png"), key=_order)


def _order(picture: Path) -> tuple[str, float]:
    kind, _, angle = title(picture).rpartition(" ")
    digits = angle.rstrip("°")
    return kind, float(digits) if digits.replace(".", "").isdigit() else 0.0


def title(picture: Path) -> str:
    """`orbit 5°`."""
    return picture.stem.removeprefix("camera-")


def write(views: Sequence[Path], directory: Path) -> None:
    """Write `directory`/fig3-cameras.svg and .png from the views; nothing where there are none."""
    if not views:
        return
    export.write_both(_svg(views), directory, ID, photographs=True)


def _svg(views: Sequence[Path]) -> str:
    columns = min(len(views), _COLUMNS)
    rows = -(-len(views) // columns)
    width, height = columns * (_SIDE + _GAP) + _GAP, _HEAD + rows * (_SIDE + _HEAD)
    parts = [_view(view, _GAP + i % columns * (_SIDE + _GAP), _HEAD + i // columns * (_SIDE + _HEAD))
             for i, view in enumerate(views)]  # fmt: skip
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="{theme.FONT}" '
        f'fill="#1f2328"><rect width="{width}" height="{height}" fill="#ffffff"/>'
        f'<text x="{_GAP}" y="24" font-size="13" font-weight="600">{TITLE}</text>{"".join(parts)}</svg>'
    )


def _view(view: Path, x: int, y: int) -> str:
    data = base64.b64encode(_small(view)).decode()
    return (
        f'<text x="{x}" y="{y + 14}" font-size="12">{escape(title(view))}</text>'
        f'<image x="{x}" y="{y + 22}" width="{_SIDE}" height="{_SIDE}" href="data:image/jpeg;base64,{data}"/>'
    )


def _small(view: Path) -> bytes:
    """The picture as JPEG, colours at full resolution: a third of the bytes."""
    stream = BytesIO()
    with Image.open(view) as image:
        image.convert("RGB").save(stream, "JPEG", quality=_QUALITY, subsampling=0)
    return stream.getvalue()
