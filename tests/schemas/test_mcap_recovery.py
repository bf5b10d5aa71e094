"""What is kept of a damaged file is what was written; what is not is said."""

import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from schemas.errors import ArtifactError
from schemas.mcap_recovery import recover

EVERY = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
Message = tuple[int, bytes]


def write(path: Path, compression: CompressionType, chunk: int = 700) -> list[Message]:
    """Sixty messages in several chunks; they do not compress to nothing."""
    sent = [(i, bytes((i * j * j) % 251 for j in range(50))) for i in range(60)]
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=chunk)
        writer.start()
        writer.add_metadata("episode", {"seed": "7"})
        channel = writer.register_channel("/topic", "raw", writer.register_schema("raw", "", b""))
        for time, data in sent:
            writer.add_message(channel, time, data, time)
        writer.finish()
    return sent


def read(path: Path) -> list[Message]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [(message.log_time, message.data) for _, _, message in make_reader(file).iter_messages()]


COMPRESSIONS = pytest.mark.parametrize("compression", list(CompressionType))


@COMPRESSIONS
def test_a_whole_file(tmp_path: Path, compression: CompressionType) -> None:
    sent = write(tmp_path / "a.mcap", compression)
    found = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert found.is_whole and found.messages == {"/topic": 60} and found.last_time_ns == 59
    assert read(tmp_path / "b.mcap") == sent


@COMPRESSIONS
@EVERY
@given(part=st.floats(0, 1, exclude_max=True))
def test_cut_off_anywhere_the_messages_before_are_kept(
    tmp_path: Path, compression: CompressionType, part: float
) -> None:
    sent = write(tmp_path / "a.mcap", compression)
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "c.mcap").write_bytes(data[: max(8, int(part * len(data)))])
    found = recover(tmp_path / "c.mcap", tmp_path / "b.mcap")
    kept = read(tmp_path / "b.mcap")
    assert kept == sent[: len(kept)] and found.messages.total() == len(kept)
    assert found.lost, "what is missing is said"


def test_without_compression_nothing_whole_is_lost(tmp_path: Path) -> None:
    """Half of the bytes hold about half of the messages."""
    write(tmp_path / "a.mcap", CompressionType.NONE)
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "c.mcap").write_bytes(data[: len(data) // 2])
    assert 20 <= recover(tmp_path / "c.mcap", tmp_path / "b.mcap").messages.total() <= 35


@COMPRESSIONS
@EVERY
@given(part=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_never_makes_a_message_that_was_not_written(
    tmp_path: Path, compression: CompressionType, part: float, bit: int
) -> None:
    sent = set(write(tmp_path / "a.mcap", compression))
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[8 + int(part * (len(data) - 8))] ^= 1 << bit
    (tmp_path / "c.mcap").write_bytes(data)
    recover(tmp_path / "c.mcap", tmp_path / "b.mcap")
    assert set(read(tmp_path / "b.mcap")) <= sent


def test_no_mcap_file(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"PAR1 and more")
    with pytest.raises(ArtifactError, match="does not begin as an MCAP file does"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")


def test_a_chunk_that_is_a_bomb_is_not_let_off(tmp_path: Path) -> None:
    """A gigabyte in some kilobytes, said to be a hundred bytes."""
    compressor, zeros = zstandard.ZstdCompressor().compressobj(), bytes(2**24)
    data = b"".join(compressor.compress(zeros) for _ in range(64)) + compressor.flush()
    content = struct.pack("<QQQII", 0, 0, 100, 0, 4) + b"zstd" + struct.pack("<Q", len(data)) + data
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(content)) + content)
    tracemalloc.start()
    found = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "is damaged and was dropped" in found.lost[0]
    assert peak < 2**29
