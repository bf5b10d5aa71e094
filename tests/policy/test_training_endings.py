"""The training loop on fake worlds: resuming changes nothing."""

from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from schemas.errors import ArtifactError
from schemas.progress import Silent
from stages.policy import checkpoint, parts, train
from stages.policy.checkpoint import Position
from stages.policy.group import Schedule
from stages.policy.growing import Growing
from stages.policy.loop import Lockstep
from stages.policy.resources import Resources
from stages.policy.salvage import assess, cut
from stages.policy.td3 import TD3
from tests.policy.small_training import CONFIG, HORIZON, everything, run_specs, trained, transitions


class _StopError(Exception):
    pass


_SAVE = checkpoint.save


def _killed_at_the_second_of_4(
    out: Path, run: str, position: Position, td3: TD3, row: int, counts: dict[str, int]
) -> None:
    """Saves, but for the second run's checkpoint after 4 episodes."""
    if position.episodes == 4 and row == 1:
        raise _StopError
    _SAVE(out, run, position, td3, row, counts)


def _swap(one: Path, other: Path) -> None:
    aside = one.with_name("aside")
    one.rename(aside)
    other.rename(one)
    aside.rename(other)


class Stopping(Silent):
    """Asks to stop when it has been asked `after` times."""

    def __init__(self, after: int) -> None:
        self.left = after

    def stopping(self) -> bool:
        self.left -= 1
        return self.left < 0


@pytest.mark.usefixtures("fake")
class TestStop:
    @pytest.mark.parametrize("after", [0, 2, 3, 5, 6, 8])
    def test_every_whole_episode_is_kept_and_resumed_equals_uninterrupted(self, tmp_path: Path, after: int) -> None:
        """Asked after each of six training and five final episodes; checkpoints are due after every second one.

        After four the reward switches, and new critics catch up.
        """
        config = CONFIG.model_copy(update={"final_episodes": 5, "reset": "critics", "reset_updates": 5})
        whole, stopped = (run_specs(tmp_path / name, ("dense2sparse", "sparse"), config) for name in ("a", "b"))
        trained(whole)
        with pytest.raises(KeyboardInterrupt):
            train.run(stopped, Path("e"), resources=Resources(processes=1), finished=print, progress=Stopping(after))
        kept = checkpoint.available(stopped[0].out)[-1]
        assert kept == (Position(after + 1, 0) if after < 6 else Position(6, after - 5))
        trained(stopped)
        for one, other in zip(whole, stopped, strict=True):
            assert everything(one) == everything(other)


@pytest.mark.usefixtures("fake")
class TestResume:
    @pytest.mark.parametrize("buffer", ["keep", "relabel", "empty"])
    @pytest.mark.parametrize("stop_after", [1, 6, 14, 19])
    def test_resumed_equals_uninterrupted(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop_after: int, buffer: str
    ) -> None:
        """Going on from nothing, from before the switch (2), from after it (6) and from the final evaluation.

        Rollouts come as 2 training and 2 evaluation episodes in turn, ten of each, then the final ones.
        """
        config = CONFIG.model_copy(update={"buffer": buffer, "reset": "critics", "episodes": 10, "final_episodes": 5})
        schemes = ("dense2sparse", "dense")
        whole, broken = run_specs(tmp_path / "whole", schemes, config), run_specs(tmp_path / "broken", schemes, config)
        trained(whole)
        calls, original = [], Lockstep._rollout

        def stopping(self: Lockstep, *arguments: object) -> None:
            calls.append(arguments)
            if len(calls) > stop_after:
                raise _StopError
            original(self, *arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "_rollout", stopping)
        with pytest.raises(_StopError):
            trained(broken)
        resume_points = {1: [], 6: [2], 14: [4, 6], 19: [6, 8]}
        assert [point.episodes for point in checkpoint.available(broken[0].out)] == resume_points[stop_after]
        monkeypatch.setattr(Lockstep, "_rollout", original)
        trained(broken)
        for one, other in zip(whole, broken, strict=True):
            assert everything(one) == everything(other)

    def test_runs_killed_one_checkpoint_apart_go_on_from_the_older(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Killed while the second run's checkpoint at 4 was to be written: both go on from 2, and end the same."""
        whole, broken = (run_specs(tmp_path / name, ("dense", "sparse")) for name in ("whole", "broken"))
        trained(whole)
        monkeypatch.setattr(checkpoint, "save", _killed_at_the_second_of_4)
        with pytest.raises(_StopError):
            trained(broken)
        assert [[p.episodes for p in checkpoint.available(spec.out)] for spec in broken] == [[2, 4], [2]]
        monkeypatch.setattr(checkpoint, "save", _SAVE)
        trained(broken)
        assert [everything(spec) for spec in whole] == [everything(spec) for spec in broken]

    def test_runs_that_went_on_from_an_older_checkpoint_forget_the_newer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Killed one checkpoint apart, resumed, killed at once: the first alone still goes on, to the same end."""
        whole, broken = (run_specs(tmp_path / name, ("dense", "sparse")) for name in ("whole", "broken"))
        trained(whole)
        monkeypatch.setattr(checkpoint, "save", _killed_at_the_second_of_4)
        for _ in range(2):
            with pytest.raises(_StopError):
                trained(broken)
        monkeypatch.setattr(checkpoint, "save", _SAVE)
        train_episode = Lockstep.train_episode
        monkeypatch.setattr(Lockstep, "train_episode", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            trained(broken)
        assert [[p.episodes for p in checkpoint.available(spec.out)] for spec in broken] == [[2], [2]]
        monkeypatch.setattr(Lockstep, "train_episode", train_episode)
        trained(broken[:1])
        assert everything(broken[0]) == everything(whole[0])

    def test_a_run_that_ended_is_not_trained_again(self, tmp_path: Path) -> None:
        """Killed after the policy was kept and before the manifest said so: the result is there, the files stay."""
        [spec] = run_specs(tmp_path, ("dense",))
        [result] = trained([spec])
        before = {path: path.stat().st_mtime_ns for path in spec.out.rglob("*") if path.is_file()}
        half = spec.out / "checkpoints" / "000006-000000"  # killed before its checkpoints were dropped
        half.mkdir()
        (half / "td3.safetensors").write_bytes(b"")
        assert trained([spec]) == [result]
        assert before == {path: path.stat().st_mtime_ns for path in spec.out.rglob("*") if path.is_file()}

    @pytest.mark.parametrize(
        ("file", "damage"),
        [
            ("checkpoints/policy.safetensors", lambda data: data[:100]),
            ("checkpoints/policy.safetensors", lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:]),
            ("checkpoints/policy.json", lambda data: data.replace(b'"episodes": 6', b'"episodes": 7')),
            ("checkpoints/policy.json", lambda data: b'{"summary": {"final_return": 999}}'),
            ("checkpoints/policy.json", lambda data: b'{"summary": 3}'),
            ("checkpoints/policy.json", lambda data: b"[]"),
            ("checkpoints/policy.json", lambda data: b"null"),
            ("checkpoints/policy.json", lambda data: data[:30]),
        ],
    )
    def test_an_ended_run_whose_policy_is_damaged(
        self, tmp_path: Path, file: str, damage: Callable[[bytes], bytes]
    ) -> None:
        """Neither is it taken for complete, nor trained again over the log of hours."""
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        before = (spec.out / file).read_bytes()
        (spec.out / file).write_bytes(damage(before))
        assert (spec.out / file).read_bytes() != before
        logged = transitions(spec)["reward_used"].tolist()
        with pytest.raises(ArtifactError, match=rf"had ended, but {file} .*: `pipeline repair`"):
            trained([spec])
        assert transitions(spec)["reward_used"].tolist() == logged

    @pytest.mark.parametrize("name", ["transitions/part-00000.parquet", "episodes.parquet", "updates.parquet"])
    def test_an_ended_run_whose_log_is_damaged(self, tmp_path: Path, name: str) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        trained([spec])
        half = spec.out / "checkpoints" / "000006-000000"  # what `pipeline repair` may go on from
        half.mkdir()
        data = (spec.out / name).read_bytes()
        (spec.out / name).write_bytes(data[:-100] + bytes([data[-100] ^ 1]) + data[-99:])
        with pytest.raises(ArtifactError, match=rf"had ended, but {name} is not what was written: `pipeline repair`"):
            trained([spec])
        assert half.exists()

    def test_results_come_as_soon_as_a_group_has_ended(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """An interruption in the second group leaves the first group's results as they are."""
        specs = run_specs(tmp_path / "a", ("dense",))
        specs += run_specs(tmp_path / "b", ("dense",), CONFIG.model_copy(update={"episodes": 8}))
        original, results = Lockstep.train_episode, []

        def stopping(self: Lockstep, episode: int, task: object) -> None:
            if self.config.episodes == 8:
                raise KeyboardInterrupt
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", stopping)
        with pytest.raises(KeyboardInterrupt):
            train.run(specs, Path("e"), resources=Resources(processes=1), finished=results.append, progress=Silent())
        assert [result.run_id for result in results] == [specs[0].run_id]

    def test_a_damaged_checkpoint_is_a_clear_error(self, tmp_path: Path) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        directory = spec.out / "checkpoints" / "000002-000000"
        directory.mkdir(parents=True)
        (directory / "td3.safetensors").write_bytes(b"not a checkpoint")
        with pytest.raises(ArtifactError, match="checkpoint .*000002-000000 cannot be read"):
            trained([spec])

    @pytest.mark.parametrize("file", ["td3.safetensors", "state.json"])
    def test_one_digit_or_bit_of_a_checkpoint(self, tmp_path: Path, file: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """It would be read as another weight, or as another number of rows."""
        [spec] = run_specs(tmp_path, ("dense",))
        monkeypatch.setattr(Schedule, "_final", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            trained([spec])
        path = spec.out / "checkpoints" / checkpoint.available(spec.out)[-1].name / file
        data = path.read_bytes()
        at = data.rindex(b'}, "sha256"') - 1 if file == "state.json" else len(data) - 100
        path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        with pytest.raises(ArtifactError, match="it is not what was written"):
            trained([spec])

    @pytest.mark.parametrize(
        ("names", "said"),
        [
            (["transitions"], "part-00000.parquet is of another run"),
            (["episodes.parquet"], "episodes.parquet is of another run"),
            (["checkpoints"], "it is of t/reach-sparse-pan00-seed0"),
            (["transitions", "episodes.parquet", "updates.parquet", "evaluations.parquet", "checkpoints"], "it is of"),
        ],
    )
    def test_what_changed_places_with_another_runs(
        self, tmp_path: Path, names: list[str], said: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Its checksums hold. A repaired run is trained anew, to the same end."""
        specs, whole = (run_specs(tmp_path / name, ("dense", "sparse")) for name in ("swapped", "whole"))
        trained(whole)
        with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
            patch.setattr(Schedule, "_final", lambda *_: 1 / 0)
            trained(specs)
        for name in names:
            _swap(*(spec.out / name for spec in specs))
        with pytest.raises(ArtifactError, match=said):
            trained(specs)
        for spec in specs:
            found = assess(spec.out, spec.identity, ())
            assert found.lost and not found.checkpoints
            cut(spec.out, found)
        trained(specs)
        assert [everything(spec) for spec in specs] == [everything(spec) for spec in whole]

    @pytest.mark.parametrize(
        ("one", "other", "said"),
        [
            ("transitions/part-00000.parquet", "transitions/part-00001.parquet", "holds other episodes than it did"),
            ("episodes.parquet", "evaluations.parquet", "episodes.parquet is another table"),
        ],
    )
    def test_what_changed_places_within_a_run(
        self, tmp_path: Path, one: str, other: str, said: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(parts, "PART_ROWS", 6 * HORIZON)
        [spec] = run_specs(tmp_path, ("dense",))
        with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
            patch.setattr(Schedule, "_final", lambda *_: 1 / 0)
            trained([spec])
        _swap(spec.out / one, spec.out / other)
        with pytest.raises(ArtifactError, match=said):
            trained([spec])
        assert assess(spec.out, spec.identity, ()).lost

    def test_killed_before_the_episodes_were_told_of_nothing_is_damaged(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Transitions are written first; those of episodes that nobody tells of are written again."""
        [spec], [whole] = (run_specs(tmp_path / name, ("dense",)) for name in ("killed", "whole"))
        trained([whole])
        write, told = Growing.flush, [0]

        def killed(self: Growing) -> None:
            told[0] += 1
            if told[0] > 3:  # the first flush writes three tables
                raise ZeroDivisionError
            write(self)

        with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
            patch.setattr(Growing, "flush", killed)
            trained([spec])
        assert len(transitions(spec)["step"]) > HORIZON * pq.read_metadata(spec.out / "episodes.parquet").num_rows
        found = assess(spec.out, spec.identity, ())
        assert not found.lost and len(found.checkpoints) == 1
        trained([spec])
        assert everything(spec) == everything(whole)
