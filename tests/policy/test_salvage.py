"""What is left of a damaged run, and that training goes on from it to where it would have ended."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from stages.policy import checkpoint, parts
from stages.policy.config import RunSpec
from stages.policy.group import Schedule
from stages.policy.salvage import assess, cut
from tests.policy.small_training import CONFIG, HORIZON, everything, run_specs, trained, transitions

Damage = Callable[[Path], None]
ORDER = [("train", 0), ("train", 1), ("eval", 0), ("eval", 1), ("train", 2), ("train", 3), ("eval", 2), ("eval", 3)]
ORDER += [("train", 4), ("train", 5), ("eval", 4), ("eval", 5), ("final", 0), ("final", 1), ("final", 2)]


def flip(path: Path) -> None:
    """One bit of the data; a Parquet file as small as these is mostly footer."""
    data = bytearray(path.read_bytes())
    data[len(data) // 8] ^= 1
    path.write_bytes(data)


def shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


@pytest.fixture(autouse=True)
def parts_of_four_episodes(monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]) -> None:
    monkeypatch.setattr(parts, "PART_ROWS", 4 * HORIZON)


@pytest.fixture
def spec(tmp_path: Path) -> RunSpec:
    return run_specs(tmp_path, ("dense",))[0]


def logged(spec: RunSpec, table: str, column: str) -> list[object]:
    return pq.read_table(spec.out / f"{table}.parquet")[column].to_pylist()


@pytest.mark.parametrize(
    ("name", "damage", "episodes", "lost"),
    [
        ("transitions/part-00000.parquet", flip, 0, ["transitions from part-00000.parquet on", "15 of 15 episodes"]),
        ("transitions/part-00001.parquet", shorten, 4, ["transitions from part-00001.parquet on", "11 of 15 episodes"]),
        ("transitions/part-00001.parquet", Path.unlink, 4, ["transitions from part-00002.parquet on",
            "11 of 15 episodes"]),
        ("transitions/part-00003.parquet", Path.unlink, 12, ["3 of 15 episodes"]),
        ("episodes.parquet", flip, 0, ["episodes.parquet"]),
        ("updates.parquet", shorten, 15, ["updates.parquet"]),
        ("evaluations.parquet", Path.unlink, 15, ["evaluations.parquet"]),
    ],
)  # fmt: skip
def test_a_finished_run(spec: RunSpec, name: str, damage: Damage, episodes: int, lost: list[str]) -> None:
    trained([spec])
    before = everything(spec)
    damage(spec.out / name)
    whole = assess(spec.out, spec.identity, ())
    assert list(whole.lost)[: len(lost)] == lost and whole.kept.startswith(f"{episodes} episodes")
    cut(spec.out, whole)
    kept = list(zip(logged(spec, "episodes", "split"), logged(spec, "episodes", "episode"), strict=True))
    assert kept == ORDER[:episodes]
    if episodes:
        assert len(transitions(spec)["step"]) == episodes * HORIZON
    trained_episodes = sum(split == "train" for split, _ in kept)
    assert all(episode < trained_episodes for episode in logged(spec, "updates", "episode"))  # type: ignore[operator]
    assert sum(logged(spec, "evaluations", "episodes")) <= len(kept) - trained_episodes  # type: ignore[arg-type]
    assert not assess(spec.out, spec.identity, ()).lost or not episodes, "what was cut is whole"
    assert [result.status for result in trained([spec])] == ["complete"]
    assert everything(spec) == before


@pytest.mark.parametrize(
    ("name", "damage", "point", "lost"),
    [
        ("transitions/part-00002.parquet", Path.unlink, 4, ["4 of 12 episodes", "checkpoint 000006-000000"]),
        ("transitions/part-00001.parquet", flip, None, ["transitions from part-00001.parquet on", "8 of 12 episodes",
            "checkpoint 000004-000000", "checkpoint 000006-000000"]),
        ("checkpoints/000006-000000/td3.safetensors", flip, 4, ["checkpoint 000006-000000"]),
        ("checkpoints/000006-000000/state.json", shorten, 4, ["checkpoint 000006-000000"]),
    ],
)  # fmt: skip
def test_an_unfinished_run(
    spec: RunSpec, tmp_path: Path, name: str, damage: Damage, point: int | None, lost: list[str]
) -> None:
    """It goes on from the newest checkpoint that is whole and whose log is."""
    [other] = run_specs(tmp_path / "whole", ("dense",))
    trained([other])
    with pytest.MonkeyPatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(Schedule, "_final", lambda *_: 1 / 0)
        trained([spec])
    assert assess(spec.out, spec.identity, ()).lost == ()
    damage(spec.out / name)
    whole = assess(spec.out, spec.identity, ())
    assert set(lost) <= set(whole.lost)
    cut(spec.out, whole)
    assert [each.episodes for each in checkpoint.available(spec.out)] == ([point] if point else [])
    trained([spec])
    assert everything(spec) == everything(other)


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("from_logs", [True, False])
def test_what_is_whole_stays(tmp_path: Path, finished: bool, from_logs: bool) -> None:
    """Nothing is lost of a run that nothing happened to; one that learns from logs has no training episodes."""
    [spec] = run_specs(tmp_path / "source", ("dense",))
    trained([spec])
    if from_logs:
        [learner] = run_specs(tmp_path / "learner", ("dense",), CONFIG.model_copy(update={"warmup_episodes": 0}))
        spec = replace(learner, sources=(spec.out,))
    if finished:
        trained([spec])
    else:
        shutil.rmtree(spec.out)
        spec.out.mkdir()
        with pytest.MonkeyPatch.context() as patch, pytest.raises(ZeroDivisionError):
            patch.setattr(Schedule, "_final", lambda *_: 1 / 0)
            trained([spec])
    whole = assess(spec.out, spec.identity, (), from_logs)
    assert whole.lost == () and len(whole.checkpoints) == (0 if finished else 2)
    assert whole.logs["updates"].num_rows == len(logged(spec, "updates", "update")) > 0
