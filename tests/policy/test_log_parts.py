"""The parts of a run's log: merged when it is over, whole after a kill, encoded as its columns need."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas import tables
from schemas.files import write_parquet
from stages.policy import log as log_module
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
    return sorted((spec.out / "transitions").iterdir())


def _rows(spec: RunSpec) -> list[dict]:
    return pa.concat_tables(map(pq.read_table, _paths(spec))).to_pylist()


def test_parts_of_a_run_that_is_over_are_merged(spec: RunSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    """At least so many rows in each but the last; the rows are those there were, in their order."""
    monkeypatch.setattr(log_module, "PART_ROWS", 3 * STEPS)
    log = _write(spec, parts=5)
    before = _rows(spec)
    assert len(_paths(spec)) == 5
    log.finish()
    assert [path.name for path in _paths(spec)] == [f"part-{number:05d}.parquet" for number in range(4)]
    assert [pq.read_metadata(path).num_rows for path in _paths(spec)] == [15, 15, 15, 5]
    assert _rows(spec) == before
    assert [path.name for path in spec.out.iterdir() if path.name.startswith(".")] == []
    merged = [path.read_bytes() for path in _paths(spec)]
    log.finish()
    assert [path.read_bytes() for path in _paths(spec)] == merged


@pytest.mark.parametrize("cuts", [{0}, {1, 2}, {3, 4, 5}, {6}])
def test_where_the_parts_were_cut_does_not_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cuts: set[int]
) -> None:
    """A run that was stopped has a part more: it ends with the bytes of one that was not."""
    monkeypatch.setattr(log_module, "PART_ROWS", 3 * STEPS)
    found = []
    for name, flushed in (("whole", {1, 3, 5}), ("stopped", {1, 3, 5} | cuts)):
        spec = RunSpec("t/cell", "reach", "dense", "pan", 0.0, 0, WorldConfig(), RunConfig(), tmp_path / name)
        spec.out.mkdir()
        log = RunLog(spec, 24, 7)
        for episode in range(8):
            _add(log, "eval" if episode > 5 else "train", episode)
            if episode in flushed:
                log.flush()
        log.finish()
        found.append({path.name: path.read_bytes() for path in _paths(spec)})
    assert found[0] == found[1] and len(found[0]) == 3


@pytest.mark.parametrize("renames", [0, 1, 2])
def test_a_kill_while_merging_loses_nothing(spec: RunSpec, monkeypatch: pytest.MonkeyPatch, renames: int) -> None:
    log = _write(spec)
    before, counts = _rows(spec), log.counts()
    original, done = Path.rename, []

    def killed(self: Path, target: Path) -> Path:
        if len(done) == renames:
            raise KeyboardInterrupt
        done.append(target)
        return original(self, target)

    monkeypatch.setattr(Path, "rename", killed)
    with pytest.raises(KeyboardInterrupt):
        log.finish()
    monkeypatch.undo()
    resumed = RunLog(spec, 24, 7)
    resumed.restore(counts)
    assert len(_paths(spec)) == 4
    assert _rows(spec) == before
    resumed.finish()
    assert len(_paths(spec)) == 1
    assert _rows(spec) == before
    assert len(resumed.training_transitions()["episode"]) == 4 * STEPS


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
