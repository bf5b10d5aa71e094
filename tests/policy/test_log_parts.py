"""The parts of a run's log: whole at any moment, the same wherever a run was stopped, encoded as its columns need."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas import tables
from schemas.errors import ArtifactError
from schemas.files import write_parquet
from stages.policy import parts as parts_module
from stages.policy.config import RunConfig, RunSpec
from stages.policy.episode import EpisodeColumns
from stages.policy.log import EpisodeHead, RunLog
from stages.sim.config import WorldConfig

STEPS = 5


@pytest.fixture
def spec(tmp_path: Path) -> RunSpec:
    return RunSpec("t/cell", "reach", "dense", "pan", 0.0, 0, WorldConfig(), RunConfig(), tmp_path)


def _add(log: RunLog, split: str, episode: int) -> None:
    columns = EpisodeColumns(1, STEPS, 24, 7)
    columns.columns["observation"][:] = np.random.default_rng(episode).normal(size=(1, STEPS, 24))
    columns.columns["cube_est"][:] = np.nan
    log.add_transitions(EpisodeHead(split, episode, 100, "dense" if episode else "warmup"), columns.of_run(0))
    log.add("episodes", {"split": split, "episode": episode, "length": STEPS})


def _write(spec: RunSpec, parts: int = 4) -> RunLog:
    log = RunLog(spec, 24, 7)
    for part in range(parts):
        _add(log, "train", 2 * part)
        _add(log, "eval", 2 * part + 1)
        log.flush()
    return log


def _paths(spec: RunSpec) -> list[Path]:
    return sorted((spec.out / "transitions").glob("part-*"))


def _rows(spec: RunSpec) -> list[dict]:
    return pa.concat_tables(map(pq.read_table, _paths(spec))).to_pylist()


def test_parts_grow_to_their_size(spec: RunSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    """At least so many rows in each but the last; the rows are those that were added, in their order."""
    monkeypatch.setattr(parts_module, "PART_ROWS", 3 * STEPS)
    _write(spec, parts=5)
    assert [path.name for path in _paths(spec)] == [f"part-{number:05d}.parquet" for number in range(4)]
    assert [pq.read_metadata(path).num_rows for path in _paths(spec)] == [15, 15, 15, 5]
    assert [row["episode"] for row in _rows(spec)] == [episode for episode in range(10) for _ in range(STEPS)]


@pytest.mark.parametrize("cuts", [set(), {1, 2}, {3, 4, 5}, {0, 6}])
def test_when_it_was_written_does_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cuts: set[int]) -> None:
    """A run that was stopped was written once more: it ends with the bytes of one that was not."""
    monkeypatch.setattr(parts_module, "PART_ROWS", 3 * STEPS)
    found = []
    for name, flushed in (("whole", {1, 3, 5, 7}), ("stopped", {7} | cuts)):
        spec = RunSpec("t/cell", "reach", "dense", "pan", 0.0, 0, WorldConfig(), RunConfig(), tmp_path / name)
        spec.out.mkdir()
        log = RunLog(spec, 24, 7)
        for episode in range(8):
            _add(log, "eval" if episode > 5 else "train", episode)
            if episode in flushed:
                log.flush()
        found.append({path.name: path.read_bytes() for path in _paths(spec)})
    assert found[0] == found[1] and len(found[0]) == 3


@pytest.mark.parametrize("episodes", range(9))
def test_going_back_to_a_checkpoint(spec: RunSpec, monkeypatch: pytest.MonkeyPatch, episodes: int) -> None:
    """Whatever was written after it goes; what is then written again makes the same bytes."""
    monkeypatch.setattr(parts_module, "PART_ROWS", 3 * STEPS)
    log = _write(spec)
    before, whole = _rows(spec), {path.name: path.read_bytes() for path in _paths(spec)}
    counts = log.counts() | {"episodes": episodes}
    resumed = RunLog(spec, 24, 7)
    resumed.restore(counts)
    assert (_rows(spec) if episodes else []) == before[: STEPS * episodes]
    assert len(_paths(spec)) == -(-episodes // 3), "no part is empty"
    assert len(resumed.training_transitions()["episode"]) == -(-episodes // 2) * STEPS
    for episode in range(episodes, 8):
        _add(resumed, "eval" if episode % 2 else "train", episode)
    resumed.flush()
    assert {path.name: path.read_bytes() for path in _paths(spec)} == whole


def test_fewer_transitions_than_episodes(spec: RunSpec) -> None:
    log = _write(spec)
    _paths(spec)[0].unlink()
    with pytest.raises(ArtifactError, match=r"holds 0 transitions, its episodes have 40: see `pipeline repair`"):
        RunLog(spec, 24, 7).restore(log.counts())


def test_readers_see_whole_episodes_at_any_moment(spec: RunSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the first to some later one, before and after every file that is written, renamed or removed."""
    monkeypatch.setattr(parts_module, "PART_ROWS", 3 * STEPS)
    seen: list[int] = []

    def look() -> None:
        steps = [(row["episode"], row["step"]) for path in _paths(spec) for row in pq.read_table(path).to_pylist()]
        assert steps == [(episode, step) for episode in range(len(steps) // STEPS) for step in range(STEPS)]
        seen.append(len(steps) // STEPS)

    def looked_at(act: Callable[..., Any]) -> Callable[..., Any]:
        def acting(*arguments: Any, **options: Any) -> Any:
            look()
            result = act(*arguments, **options)
            look()
            return result

        return acting

    monkeypatch.setattr(Path, "replace", looked_at(Path.replace))
    monkeypatch.setattr(Path, "unlink", looked_at(Path.unlink))
    log = _write(spec, parts=5)
    RunLog(spec, 24, 7).restore(log.counts() | {"episodes": 1})
    assert set(seen) == {0, 1, 2, 3, 4, 6, 8, 9, 10}  # 9: a part was full, the next not there yet


def test_rows_of_a_part_are_its_episodes(spec: RunSpec) -> None:
    _write(spec, parts=1)
    table = pq.read_table(_paths(spec)[0])
    assert table.schema.equals(tables.transitions(24, 7))
    assert table["split"].to_pylist() == ["train"] * STEPS + ["eval"] * STEPS
    assert table["phase"].to_pylist() == ["warmup"] * STEPS + ["dense"] * STEPS
    assert table["global_step"].to_pylist() == [100, 101, 102, 103, 104] + [100] * STEPS
    assert table["truncated"].to_pylist() == 2 * ([False] * (STEPS - 1) + [True])
    assert table["cube_est_x"].null_count == 2 * STEPS


def test_encodings(spec: RunSpec) -> None:
    """Measured numbers split by bytes, counters as differences, words and what repeats as dictionaries."""
    _write(spec, parts=1)
    group = pq.read_metadata(_paths(spec)[0]).row_group(0)
    encodings = {group.column(i).path_in_schema: group.column(i).encodings for i in range(group.num_columns)}
    assert "BYTE_STREAM_SPLIT" in encodings["observation.list.element"]
    assert "BYTE_STREAM_SPLIT" in encodings["distance_true"]
    assert "DELTA_BINARY_PACKED" in encodings["global_step"]
    assert "RLE_DICTIONARY" in encodings["run"]
    assert "RLE_DICTIONARY" in encodings["episode"]


def test_any_table_can_be_written(tmp_path: Path) -> None:
    """Also what analysis writes: times, plain words, nulls, no columns."""
    table = pa.table(
        {
            "when": pa.array([1, None], pa.timestamp("us")),
            "word": ["a", None],
            "number": [0.5, None],
            "flag": [True, None],
            "list": [[1, 2], None],
            "words": [["a"], []],
        }
    )
    write_parquet(table, tmp_path / "a.parquet")
    assert pq.read_table(tmp_path / "a.parquet").equals(table)
    write_parquet(pa.table({}), tmp_path / "b.parquet")
    assert pq.read_table(tmp_path / "b.parquet").num_columns == 0
