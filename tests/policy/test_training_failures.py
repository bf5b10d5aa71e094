"""The training loop on fake worlds: a run that fails takes no other with it, and keeps what was finished."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from safetensors.torch import load_file

from schemas.errors import ConfigError, MachineError
from schemas.progress import Silent
from stages.policy import checkpoint, train
from stages.policy.loop import Lockstep
from stages.policy.resources import Resources
from stages.policy.td3 import TD3
from tests.fake_worlds import FakeEstimator
from tests.policy.small_training import CONFIG, everything, run_specs, trained, transitions


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
