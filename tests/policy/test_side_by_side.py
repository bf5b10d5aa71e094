"""Runs in several processes, with real worlds: the same bytes as in one, and no process left behind."""

import multiprocessing
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.training import random_estimator
from schemas.errors import MachineError
from schemas.progress import Silent
from stages.policy import checkpoint, train
from stages.policy.config import RunConfig, RunSpec, TD3Config
from stages.policy.resources import Resources, Share
from stages.sim.config import WorldConfig

CONFIG = RunConfig(
    episodes=3,
    warmup_episodes=1,
    eval_every=2,
    eval_episodes=1,
    final_episodes=1,
    checkpoint_every=1,
    td3=TD3Config(hidden=(16, 16), batch_size=16),
)


def _specs(root: Path) -> list[RunSpec]:
    specs = []
    for seed in range(3):
        out = root / f"seed{seed}"
        out.mkdir(parents=True)
        specs.append(RunSpec(f"t/seed{seed}", "reach", "oracle", "pan", 0.0, seed, WorldConfig(horizon=5), CONFIG, out))
    return specs


def _bytes(spec: RunSpec) -> dict[str, bytes]:
    """All that does not hold wall times."""
    names = ["evaluations.parquet", "updates.parquet", "transitions/part-00000.parquet"]
    return {name: (spec.out / name).read_bytes() for name in [*names, "checkpoints/policy.safetensors"]}


def test_any_number_of_processes_workers_and_threads_gives_the_same_bytes(tmp_path: Path) -> None:
    found = []
    for processes, workers, threads in ((1, 0, 1), (1, 2, 2), (2, 0, 1), (3, 1, 2)):
        specs, results = _specs(tmp_path / f"{processes}-{workers}-{threads}"), []
        resources = Resources("cpu", processes, workers, threads)
        train.run(specs, None, resources=resources, finished=results.append, progress=Silent())
        assert sorted(result.run_id for result in results) == ["t/seed0", "t/seed1", "t/seed2"]
        assert {result.status for result in results} == {"complete"}
        found.append([_bytes(spec) for spec in specs])
    assert found[0] == found[1] == found[2] == found[3]
    assert found[0][0] != found[0][1], "seeds differ, or the comparison says nothing"
    assert multiprocessing.active_children() == []


def test_emptying_the_buffer_is_the_same_in_any_company(tmp_path: Path) -> None:
    """The emptied run pauses a step: its random streams stand still, also beside a run that goes on learning."""
    config = CONFIG.model_copy(update={"buffer": "empty", "switch_episode": 2})
    found = []
    for processes in (1, 2):
        specs = [
            replace(spec, scheme=scheme, config=config, task="reach")
            for spec, scheme in zip(_specs(tmp_path / str(processes))[:2], ("dense", "dense2sparse"), strict=True)
        ]
        resources = Resources("cpu", processes, 0, 1)
        train.run(
            specs, random_estimator(tmp_path / str(processes)), resources=resources, finished=print, progress=Silent()
        )
        found.append([_bytes(spec) for spec in specs])
    assert found[0] == found[1]


def test_asked_to_stop_every_process_keeps_its_episodes(tmp_path: Path) -> None:
    class Stopping(Silent):
        """Its SIGTERM went to every process, as a supervisor sends it."""

        def stopping(self) -> bool:
            for process in multiprocessing.active_children():
                process.terminate()
            return True

    config = CONFIG.model_copy(update={"episodes": 10_000, "checkpoint_every": 10_000, "eval_every": 10_000})
    specs = [replace(spec, config=config) for spec in _specs(tmp_path)]
    with pytest.raises(KeyboardInterrupt):
        train.run(specs, None, resources=Resources(processes=3), finished=print, progress=Stopping())
    kept = [checkpoint.available(spec.out) for spec in specs]
    assert all(len(positions) == 1 and positions[0].episodes < 100 for positions in kept)
    assert multiprocessing.active_children() == []


def test_a_killed_process_is_reported_and_its_neighbours_keep_their_episodes(tmp_path: Path) -> None:
    class Killing(Silent):
        def task(self, label: str, total: int, done: int = 0):
            next(each for each in multiprocessing.active_children() if each.name == "train-t/seed1").kill()
            return super().task(label, total, done)

    config = CONFIG.model_copy(update={"episodes": 10_000, "checkpoint_every": 10_000, "eval_every": 10_000})
    specs = [replace(spec, config=config) for spec in _specs(tmp_path)]
    with pytest.raises(MachineError, match=r"training process died \(exit code -9\).*--resume"):
        train.run(specs, None, resources=Resources(processes=3), finished=print, progress=Killing())
    assert [len(checkpoint.available(spec.out)) for spec in specs] == [1, 0, 1]
    assert multiprocessing.active_children() == []


def test_one_that_cannot_begin_lets_its_neighbours_keep_their_episodes(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"episodes": 10_000, "checkpoint_every": 10_000, "eval_every": 10_000})
    specs = [replace(spec, config=config) for spec in _specs(tmp_path)]
    specs[1].out.rmdir()
    with pytest.raises(FileNotFoundError, match="seed1"):
        train.run(specs, None, resources=Resources(processes=3), finished=print, progress=Silent())
    assert [len(checkpoint.available(spec.out)) for spec in specs] == [1, 0, 1]
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    ("asked", "runs", "cores", "share"),
    [
        (Resources(), 12, 2, Share("cpu", 2, 0, 1)),
        (Resources(), 1, 2, Share("cpu", 1, 1, 2)),
        (Resources(), 12, 16, Share("cpu", 12, 0, 1)),
        (Resources(), 4, 16, Share("cpu", 4, 1, 4)),
        (Resources("cuda"), 36, 16, Share("cuda", 1, 16, 16)),
        (Resources("cpu", processes=1, workers=3, threads=2), 12, 2, Share("cpu", 1, 3, 2)),
    ],
)
def test_who_gets_what(asked: Resources, runs: int, cores: int, share: Share, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stages.policy.resources.available_cores", lambda: cores)
    assert asked.share(runs) == share
