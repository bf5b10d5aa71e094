"""A real training to measure: reach runs with camera and estimator, logs and checkpoints in a temporary directory.

The estimator's weights are random, for its speed does not depend on them.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

import psutil
import torch

from schemas.progress import Silent
from stages.perception.estimator import EstimatorCard, save_estimator
from stages.perception.normalisation import Normalisation
from stages.perception.quantised import measure_ranges
from stages.perception.resnet34 import ResNet34
from stages.policy.config import RunConfig, RunResult, RunSpec, Scheme
from stages.policy.resources import Resources
from stages.policy.train import run
from stages.sim.config import CameraConfig, WorldConfig

IMAGE_SIZE = 64
SCHEMES: tuple[Scheme, ...] = get_args(Scheme)


class Rounds(Silent):
    """A progress bar that calls `after` with the environment steps/s of every round: an episode of every process.

    The first round, without updates, has the number 0. What the callback takes is not counted, and the training
    processes stand still meanwhile.
    """

    def __init__(self, runs: int, resources: Resources, after: Callable[[int, float], None], awake: int | None) -> None:
        self._processes = resources.share(runs).processes
        self._steps, self._after, self._awake = runs * WorldConfig().horizon, after, awake
        self._done, self._since = 0, time.perf_counter()

    @contextmanager
    def task(self, label: str, total: int, done: int = 0) -> Iterator["Rounds"]:
        """The only bar."""
        del label, total, done
        self._since = time.perf_counter()
        yield self

    def advance(self, units: int = 1) -> None:
        """An episode of one process ended."""
        self._done += units
        if self._done % self._processes == 0:
            rate = self._steps / (time.perf_counter() - self._since)
            with suspended(self._awake):
                self._after(self._done // self._processes - 1, rate)
            self._since = time.perf_counter()

    def note(self, text: str) -> None:
        """Nothing is shown."""
        del text


@contextmanager
def suspended(awake: int | None) -> Iterator[None]:
    """All processes that this one started stand still in this block, but the one with the id `awake`."""
    others = [process for process in psutil.Process().children(recursive=True) if process.pid != awake]
    for process in others:
        process.suspend()
    try:
        yield
    finally:
        for process in others:
            process.resume()


def train(
    runs: int, rounds: int, after: Callable[[int, float], None], resources: Resources, awake: int | None = None
) -> None:
    """Train `runs` reach runs for an episode without updates and `rounds` with, and forget them.

    Logs and checkpoints are written every third episode, more often than by default. The process with the id
    `awake` does not stand still while `after` is called.
    """
    config = RunConfig(
        episodes=1 + rounds,
        warmup_episodes=1,
        switch_episode=1 + rounds // 2,
        eval_every=10**6,
        final_episodes=0,
        checkpoint_every=3,
    )
    results: list[RunResult] = []
    with tempfile.TemporaryDirectory() as directory:
        root = Path(directory)
        specs = [_spec(root, number, config) for number in range(runs)]
        progress = Rounds(runs, resources, after, awake)
        run(specs, random_estimator(root), resources=resources, finished=results.append, progress=progress)
    assert [result.status for result in results] == ["complete"] * runs, results


def _spec(root: Path, number: int, config: RunConfig) -> RunSpec:
    out = root / f"run{number}"
    out.mkdir()
    scheme = SCHEMES[number % len(SCHEMES)]
    return RunSpec(f"bench/run{number}", "reach", scheme, "orbit", 0.0, number, WorldConfig(), config, out)


def random_estimator(root: Path) -> Path:
    """The directory of an estimator with random weights, in `root`."""
    directory = root / "estimator"
    directory.mkdir()
    torch.manual_seed(0)
    network = ResNet34().eval()
    card = EstimatorCard(
        estimator="random",
        dataset="none",
        image_size=IMAGE_SIZE,
        precision="bfloat16",
        normalisation=Normalisation(
            pixel_mean=(128, 128, 128), pixel_std=(64, 64, 64), target_mean=(0, 0, 0.82), target_scale=0.1
        ),
        camera=CameraConfig(image_size=IMAGE_SIZE).model_dump(mode="json"),
        cube_min=(-0.2, -0.2, 0.8),
        cube_max=(0.2, 0.2, 0.9),
        best_epoch=0,
        ranges=measure_ranges(network, torch.randn(8, 3, IMAGE_SIZE, IMAGE_SIZE)),
    )
    save_estimator(directory, card, network.state_dict())
    return directory
