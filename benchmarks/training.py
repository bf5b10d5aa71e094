"""A real training to measure: reach runs with camera and estimator, logs and checkpoints in a temporary directory.

The estimator's weights are random, for its speed does not depend on them.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from schemas.config import Precision
from stages.perception.estimator import EstimatorCard, save_estimator
from stages.perception.normalisation import Normalisation
from stages.perception.resnet34 import ResNet34
from stages.policy.config import RunConfig, RunResult, RunSpec, Scheme
from stages.policy.train import Resources, run
from stages.sim.config import CameraConfig, WorldConfig

IMAGE_SIZE = 64
SCHEMES: tuple[Scheme, ...] = ("dense", "sparse", "oracle", "dense2sparse")


class _Episodes:
    """A progress bar that calls back after every episode of all runs."""

    def __init__(self, after: Callable[[int, float], None]) -> None:
        self._after, self._done, self._since = after, 0, time.perf_counter()

    @contextmanager
    def task(self, label: str, total: int, done: int = 0) -> Iterator["_Episodes"]:
        """The only bar."""
        del label, total, done
        self._since = time.perf_counter()
        yield self

    def advance(self, units: int = 1) -> None:
        """An episode ended; what the callback takes is not counted to the next."""
        self._done += units
        self._after(self._done, time.perf_counter() - self._since)
        self._since = time.perf_counter()

    def note(self, text: str) -> None:
        """Nothing is shown."""
        del text


def train(
    runs: int,
    episodes: int,
    after: Callable[[int, float], None],
    *,
    resources: Resources,
    camera: bool = True,
    checkpoint_every: int = 3,
) -> None:
    """Train `runs` reach runs for `episodes` episodes, the first of them without updates, and forget them.

    `after` is called with the number of episodes done and the seconds of the last; checkpoints and logs are written
    every `checkpoint_every` episodes, within the time of the episode that follows.
    """
    config = RunConfig(
        episodes=episodes,
        warmup_episodes=1,
        switch_episode=max(episodes // 2, 1),
        eval_every=10**6,
        final_episodes=0,
        checkpoint_every=checkpoint_every,
    )
    results: list[RunResult] = []
    with tempfile.TemporaryDirectory() as directory:
        root = Path(directory)
        specs = [_spec(root, number, config, camera) for number in range(runs)]
        estimator = random_estimator(root / "estimator") if camera else None
        run(specs, estimator, resources=resources, finished=results.append, progress=_Episodes(after))
    assert [result.status for result in results] == ["complete"] * runs, results


def _spec(root: Path, number: int, config: RunConfig, camera: bool) -> RunSpec:
    out = root / f"run{number}"
    out.mkdir()
    scheme: Scheme = SCHEMES[number % len(SCHEMES)] if camera else "oracle"
    return RunSpec(f"bench/run{number}", "reach", scheme, "orbit", 0.0, number, WorldConfig(), config, out)


def random_estimator(directory: Path, precision: Precision = "bfloat16") -> Path:
    """An estimator's artifact with random weights."""
    directory.mkdir()
    torch.manual_seed(0)
    card = EstimatorCard(
        estimator="random",
        dataset="none",
        image_size=IMAGE_SIZE,
        precision=precision,
        normalisation=Normalisation(
            pixel_mean=(128, 128, 128), pixel_std=(64, 64, 64), target_mean=(0, 0, 0.82), target_scale=0.1
        ),
        camera=CameraConfig(image_size=IMAGE_SIZE).model_dump(mode="json"),
        cube_min=(-0.2, -0.2, 0.8),
        cube_max=(0.2, 0.2, 0.9),
        best_epoch=0,
    )
    save_estimator(directory, card, ResNet34().state_dict())
    return directory
