"""The training loop on fake worlds: resuming changes nothing, and a run that fails takes no other with it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from safetensors.torch import load_file

from schemas.errors import ArtifactError, ConfigError, MachineError
from schemas.progress import Silent
from stages.policy import checkpoint, parts, train
from stages.policy.checkpoint import Position
from stages.policy.group import Schedule
from stages.policy.growing import Growing
from stages.policy.loop import Lockstep
from stages.policy.resources import Resources
from stages.policy.salvage import assess, cut
from stages.policy.td3 import TD3
from tests.fake_worlds import FakeEstimator
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
    @pytest.mark.parametrize("after", [0, 2, 5, 6, 8])
    def test_every_whole_episode_is_kept_and_resumed_equals_uninterrupted(self, tmp_path: Path, after: int) -> None:
        """Asked after each of six training and five final episodes; checkpoints are due after every second one."""
        config = CONFIG.model_copy(update={"final_episodes": 5})
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


class TestFailures:
    @pytest.mark.parametrize("online", [True, False])
    def test_networks_that_are_no_numbers_are_never_kept(
        self, tmp_path: Path, fake: dict[int, int], monkeypatch: pytest.MonkeyPatch, online: bool
    ) -> None:
        """Whether a policy acts on them or not; the neighbour goes on."""
        specs = run_specs(tmp_path, ("dense", "sparse"), CONFIG.model_copy(update={"final_episodes": 0}))
        if not online:
            [source] = run_specs(tmp_path / "source", ("dense",))
            trained([source])
            specs = [replace(spec, sources=(source.out,)) for spec in specs]
        original = TD3.update

        def diverging(self: TD3, *arguments: object) -> object:
            found = original(self, *arguments)  # type: ignore[arg-type]
            if self.updates[0] == 14:
                self.critic[0, 3] = float("nan")
            return found

        monkeypatch.setattr(TD3, "update", diverging)
        results = trained(specs)
        assert [result.status for result in results] == ["failed", "complete"]
        assert "no number" in str(results[0].error) or "not a number" in str(results[0].error)
        for point in checkpoint.available(specs[0].out):
            weights = load_file(specs[0].out / "checkpoints" / point.name / "td3.safetensors")
            assert all(bool(values.isfinite().all()) for values in weights.values())

    def test_an_unstable_run_ends_and_its_neighbours_go_on(self, tmp_path: Path, fake: dict[int, int]) -> None:
        fake[1] = 3
        specs = run_specs(tmp_path, ("dense", "sparse", "oracle"))
        results = trained(specs)
        assert [result.status for result in results] == ["complete", "failed", "complete"]
        assert "unstable in train episode 0, step 3" in (results[1].error or "")
        assert not list((specs[1].out / "transitions").glob("*")), "an episode that diverged is not data"
        kept = pq.read_table(specs[1].out / "failure" / "transitions" / "part-00000.parquet", partitioning=None)
        [row] = pq.read_table(specs[1].out / "failure" / "episodes.parquet").to_pylist()
        assert kept["step"].to_pylist() == [0, 1, 2, 3] and (row["split"], row["episode"], row["length"]) == (
            "train",
            0,
            4,
        )
        assert not (specs[0].out / "failure").exists()
        assert results[0].summary["episodes"] == 6

    def test_estimates_that_are_no_numbers_end_who_acts_on_them(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]
    ) -> None:
        """While warming up the action is noise, so it would not show; an oracle only logs them."""
        original, calls = FakeEstimator.predict, [0]

        def blind(self: FakeEstimator, images: np.ndarray) -> np.ndarray:
            calls[0] += 1
            return original(self, images) * (np.nan if calls[0] == 4 else 1)  # the first sees the beginning

        monkeypatch.setattr(FakeEstimator, "predict", blind)
        results = trained(run_specs(tmp_path, ("dense", "oracle")))
        assert [result.status for result in results] == ["failed", "complete"]
        told = "what it observes or is rewarded with is not a number in train episode 0, step 2"
        assert told in (results[0].error or "")
        assert not list((tmp_path / "reach-dense-pan00-seed0" / "transitions").glob("*"))

    def test_when_every_run_fails_it_stops_and_keeps_what_was_finished(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]
    ) -> None:
        [spec] = run_specs(tmp_path, ("dense",))
        original = Lockstep.train_episode

        def third_diverges(self: Lockstep, episode: int, task: object) -> None:
            if episode == 3:
                fake[0] = 2
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", third_diverges)
        [result] = trained([spec])
        assert result.status == "failed" and "train episode 3, step 2" in (result.error or "")
        rows = transitions(spec)
        assert set(rows["episode"][rows["split"] == "train"]) == {0, 1, 2}
        assert result.summary["episodes"] == 3

    def test_a_failed_run_resumes_from_its_checkpoint(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake: dict[int, int]
    ) -> None:
        """Episodes after the checkpoint are run again, not learnt from twice."""
        [whole], [broken] = (run_specs(tmp_path / name, ("dense2sparse",)) for name in ("whole", "broken"))
        trained([whole])
        original = Lockstep.train_episode

        def fourth_diverges(self: Lockstep, episode: int, task: object) -> None:
            if episode == 3:
                fake[0] = 2
            original(self, episode, task)  # type: ignore[arg-type]

        monkeypatch.setattr(Lockstep, "train_episode", fourth_diverges)
        assert trained([broken])[0].status == "failed"
        monkeypatch.setattr(Lockstep, "train_episode", original)
        fake.clear()
        assert trained([broken])[0].status == "complete"
        assert everything(whole) == everything(broken)

    @pytest.mark.usefixtures("fake")
    def test_without_an_estimator_only_the_oracle_trains(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="--estimator"):
            trained(run_specs(tmp_path, ("dense",)), estimator=False)
        blind = CONFIG.model_copy(update={"oracle_sees": "estimate"})
        with pytest.raises(ConfigError, match="--estimator"):
            trained(run_specs(tmp_path, ("oracle",), blind), estimator=False)
        [spec] = run_specs(tmp_path, ("oracle",))
        [result] = trained([spec], estimator=False)
        rows = pq.read_table(spec.out / "episodes.parquet").to_pylist()
        assert result.status == "complete" and all(row["return_dense_est"] is None for row in rows)

    def test_no_gpu_is_exit_4(self, tmp_path: Path) -> None:
        import torch

        if torch.cuda.is_available():
            pytest.skip("this machine has a GPU")
        with pytest.raises(MachineError, match="no GPU"):
            specs = run_specs(tmp_path, ("oracle",))
            train.run(specs, None, resources=Resources("cuda"), finished=print, progress=Silent())
