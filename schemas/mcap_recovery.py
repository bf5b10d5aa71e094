"""What is whole of an MCAP file that was cut off or damaged, as a new file.

The index at a file's end is what readers need first, so a file that was cut off cannot be opened at all. Its records
can still be read from the front: a chunk that is whole is checked by its CRC, and dropped where that differs, for
nothing says which of its messages is wrong; of the chunk in which the file ends, the messages before the cut are kept.
"""

import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from schemas.errors import ArtifactError

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode, length of the content [bytes]
_CHUNK = struct.Struct("<QQQII")  # first and last time, size and CRC of its records, length of the compression's name
_STEP = 4096  # [bytes] given to a decompressor at a time: what it has told before an error counts
_LIMIT = 2**30  # [bytes] of a record, or of what a chunk holds: more is damage, not content


@dataclass(frozen=True)
class Recovered:
    """What was kept of a file, and what was not."""

    bytes: int  # of the file
    messages: Counter[str] = field(default_factory=Counter)  # kept, by topic
    last_time_ns: int | None = None  # of the messages kept
    lost: tuple[str, ...] = ()  # in words; empty: the file is whole

    @property
    def is_whole(self) -> bool:
        """Nothing was lost."""
        return not self.lost

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {**vars(self), "messages": dict(self.messages), "is_whole": self.is_whole}

    def message(self) -> str:
        """A sentence for a person."""
        kept = f"{self.messages.total():,} messages of {len(self.messages)} topics kept"
        until = "" if self.last_time_ns is None else f", up to {self.last_time_ns / 1e9:.3f} s"
        return f"{kept}{until}; " + ("nothing was lost" if self.is_whole else "; ".join(self.lost))


class _Record(NamedTuple):
    opcode: int
    content: bytes
    is_whole: bool


def recover(path: Path, target: Path) -> Recovered:
    """Write every whole message of `path`, with its schemas, channels and metadata, to `target`; what was kept.

    Raises:
        ArtifactError: it is no MCAP file.
    """
    with path.open("rb") as source, target.open("wb") as sink:
        if source.read(len(_MAGIC)) != _MAGIC:
            raise ArtifactError(f"{path} does not begin as an MCAP file does: nothing of it can be told")
        copy = _Copy(Writer(sink, compression=CompressionType.ZSTD))
        lost = tuple(dict.fromkeys(copy.records(source)))
        copy.finish()
    return Recovered(path.stat().st_size, copy.messages, copy.last_time_ns, lost)


class _Copy:
    """Puts records into a new file; the numbers of schemas and channels become the new file's."""

    def __init__(self, writer: Writer) -> None:
        self.messages: Counter[str] = Counter()
        self.last_time_ns: int | None = None
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}  # 0: none
        self._channels: dict[int, tuple[int, str]] = {}  # new number and topic
        writer.start()

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def records(self, source: IO[bytes]) -> Iterator[str]:
        """Copy all there are; yields what is lost, in words."""
        for record in _records(source):
            if record.opcode == Opcode.CHUNK:
                yield from self._chunk(record)
            elif record.is_whole and record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                if not source.read().endswith(_MAGIC):
                    yield "the index at its end was lost"
                return
            elif record.is_whole:
                yield from self._one(record.opcode, record.content)
        yield f"the file ends at byte {source.tell():,} without its index"

    def _chunk(self, record: _Record) -> Iterator[str]:
        if len(record.content) < _CHUNK.size:
            return
        *_, size, crc, name_length = _CHUNK.unpack_from(record.content)
        name = record.content[_CHUNK.size : _CHUNK.size + name_length].decode(errors="replace")
        data = record.content[_CHUNK.size + name_length + 8 :]
        records = _decompressed(name, data, size)
        if record.is_whole and (len(records) != size or (crc and zlib.crc32(records) != crc)):
            yield f"a chunk of {len(data):,} bytes is damaged and was dropped"
            return
        for inner in _records(BytesIO(records)):
            if inner.is_whole:
                yield from self._one(inner.opcode, inner.content)
        if not record.is_whole:
            yield f"of the last chunk {len(records):,} of {size:,} bytes are left"

    def _one(self, opcode: int, content: bytes) -> Iterator[str]:
        try:
            self._put(opcode, content)
        except (KeyError, ValueError, struct.error, McapError):  # outside of chunks nothing has a CRC
            yield "records outside of chunks are damaged and were dropped"

    def _put(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            number = self._writer.register_channel(
                channel.topic, channel.message_encoding, self._schemas[channel.schema_id], channel.metadata
            )
            self._channels[channel.id] = number, channel.topic
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self._writer.add_metadata(metadata.name, metadata.metadata)
        elif opcode == Opcode.ATTACHMENT:
            file = Attachment.read(stream)
            self._writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        elif opcode == Opcode.MESSAGE:
            message = Message.read(stream, len(content))
            number, topic = self._channels[message.channel_id]
            self._writer.add_message(number, message.log_time, message.data, message.publish_time, message.sequence)
            self.messages[topic] += 1
            self.last_time_ns = max(message.log_time, self.last_time_ns or 0)


def _records(source: IO[bytes]) -> Iterator[_Record]:
    """Records from the front; the last one may be cut off."""
    while len(head := source.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        content = source.read(min(length, _LIMIT))
        yield _Record(opcode, content, is_whole=len(content) == length)


def _decompressed(name: str, data: bytes, size: int) -> bytes:
    """As much as can be decompressed of data that may be cut off or damaged; a little more than `size` at most."""
    if name == "":
        return data
    decompressor = zstandard.ZstdDecompressor().decompressobj() if name == "zstd" else lz4.frame.LZ4FrameDecompressor()
    found = bytearray()
    for start in range(0, len(data), _STEP):
        try:
            found += decompressor.decompress(data[start : start + _STEP])
        except (zstandard.ZstdError, RuntimeError, EOFError):
            break
        if len(found) > min(size, _LIMIT):
            break
    return bytes(found)
