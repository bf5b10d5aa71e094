"""Episode files are whole or absent, and damage is noticed."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.writer import Writer

from schemas import mcap_files, mcap_topics
from schemas.errors import ArtifactError


def write_actions(path: Path, compression: str = "zstd", count: int = 100) -> None:
    with mcap_files.create(path, compression) as writer:
        writer.add_metadata(mcap_topics.EPISODE_METADATA, {"seed": "7"})
        for step in range(count):
            action = mcap_topics.action(step * 50, step, np.full(7, step / 100))
            mcap_files.write(writer, mcap_topics.ACTION, step * 50, action)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_round_trip(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path, compression)
    messages = list(mcap_files.read_messages(path))
    assert [(topic, time_ns, message.step) for topic, time_ns, message in messages] == [
        ("/action", 50 * step, step) for step in range(100)
    ]
    assert mcap_files.read_metadata(path) == {"seed": "7"}


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_chunks_are_compressed_and_indexed(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path, compression)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 100
    assert {index.compression for index in summary.chunk_indexes} == {compression}
    assert all(index.message_index_offsets for index in summary.chunk_indexes)


def test_topics_can_be_chosen(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path)
    assert list(mcap_files.read_messages(path, mcap_topics.SIM_STATE)) == []


def test_nothing_is_left_when_writing_fails(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="interrupted"), mcap_files.create(tmp_path / "a.mcap", "zstd"):
        raise RuntimeError("interrupted")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_rewrite_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path)
    before = path.read_bytes()
    with pytest.raises(RuntimeError), mcap_files.create(path, "zstd"):
        raise RuntimeError
    assert path.read_bytes() == before


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_truncated_file_is_an_artifact_error(tmp_path: Path, share: float) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ArtifactError, match=r"a\.mcap is damaged"):
        list(mcap_files.read_messages(path))


def test_a_flipped_bit_in_a_chunk_is_an_artifact_error(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_actions(path)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    data = bytearray(path.read_bytes())
    index = summary.chunk_indexes[0]
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(ArtifactError, match="damaged"):
        list(mcap_files.read_messages(path))


def test_missing_file_is_an_artifact_error(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="is missing"):
        list(mcap_files.read_messages(tmp_path / "a.mcap"))


def test_foreign_type_on_a_topic_is_an_artifact_error(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        writer.write_message(mcap_topics.SIM_STATE, mcap_topics.action(0, 0, np.zeros(7)), 0, 0)
    with pytest.raises(ArtifactError, match=r"/sim/state is not dense2sparse\.SimState"):
        list(mcap_files.read_messages(path))
    with pytest.raises(ArtifactError, match="no 'episode' metadata"):
        mcap_files.read_metadata(path)
