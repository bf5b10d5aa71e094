"""Files of weights that hold code, and such as lie about their lengths."""

import io
import json
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save


class Bomb:
    """Unpickled, it makes the canary."""

    def __init__(self, canary: Path) -> None:
        self.canary = canary

    def __reduce__(self) -> Any:
        return Path.touch, (self.canary,)


def _pickled(canary: Path) -> bytes:
    return pickle.dumps({"conv1.weight": Bomb(canary)})


def _saved(canary: Path, zipped: bool) -> bytes:
    buffer = io.BytesIO()
    torch.save({"conv1.weight": Bomb(canary)}, buffer, _use_new_zipfile_serialization=zipped)
    return buffer.getvalue()


def _out_of_the_zip(canary: Path) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("../../canary", "out of the archive")
        archive.writestr("archive/data.pkl", _pickled(canary))
        archive.writestr("archive/version", "3")
    return buffer.getvalue()


BOMBS: dict[str, Callable[[Path], bytes]] = {
    "pickle": _pickled,
    "zip": lambda canary: _saved(canary, zipped=True),
    "legacy": lambda canary: _saved(canary, zipped=False),
    "zip with paths": _out_of_the_zip,
}


def _safetensors(length: int, header: bytes, rest: bytes = b"") -> bytes:
    return struct.pack("<Q", length) + header + rest


def _one(**changes: Any) -> bytes:
    header = json.dumps({"conv1.weight": {"dtype": "F32", "shape": [1], "data_offsets": [0, 4], **changes}}).encode()
    return _safetensors(len(header), header, b"\0\0\0\0")


LIES = {
    "empty": b"",
    "a header of 2⁶³ bytes": _safetensors(2**63, b"{}"),
    "a header of 2⁶⁴ - 1 bytes": _safetensors(2**64 - 1, b"{}"),
    "a header of 99 MB": _safetensors(99_000_000, b"{}"),
    "a header and more": _safetensors(2, b"{}", b"x" * 100),
    "a header that is no JSON": _safetensors(4, b"nope"),
    "another type": _one(dtype="F128"),
    "a shape that does not fit": _one(shape=[1000]),
    "a huge shape": _one(shape=[2**40, 2**40]),
    "a negative shape": _one(shape=[-1]),
    "offsets beyond the end": _one(data_offsets=[0, 2**40]),
    "offsets backwards": _one(data_offsets=[4, 0]),
    "offsets as text": _one(data_offsets=["0", "4"]),
    "another network": save({"other": torch.zeros(3)}),
    "a weight of another shape": save({"conv1.weight": torch.zeros(1)}),
    "integers": save({"conv1.weight": torch.zeros(64, 3, 7, 7, dtype=torch.int8)}),
}
NAMES = (*BOMBS, *LIES)


def content(name: str, canary: Path) -> bytes:
    """One of them by name."""
    return BOMBS[name](canary) if name in BOMBS else LIES[name]
