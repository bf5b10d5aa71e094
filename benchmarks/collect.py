"""Kept frames on disk as MCAP: ours against stock stepping and rendering of the same episodes, which writes nothing."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks import roofline
from benchmarks.measure import Rate, Stopwatch, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock_episodes import CollectedEpisode, StockCollector, read_collected
from pipeline.config import load_config
from schemas.mcap_files import make_durable
from schemas.progress import Silent
from stages.collect.collector import Collector
from stages.collect.config import CollectStageConfig
from stages.collect.plan import frames_per_episode, plan_episodes
from stages.collect.run import run as collect

_WORKERS = 2
_UNCOUNTED = 2  # first episodes of each worker: they compile the scene and open OpenGL
_DATASET = "benchmark"


@dataclass(frozen=True)
class Sizes:
    """Episodes of each contender in a round, and of the pass that measures the parts; rounds."""

    ours: int
    one_worker: int
    stock: int
    parts: int
    rounds: int


QUICK, FULL = Sizes(6, 4, 1, 4, 1), Sizes(200, 60, 12, 60, 5)


def run(quick: bool) -> Outcome:
    """Rates once the processes have started, the parts of one process's time, and whether stock saw the same."""
    sizes = QUICK if quick else FULL
    one = _config(sizes.parts, 1)
    with tempfile.TemporaryDirectory() as directory:
        parts = _parts(one, Path(directory))
        collected = [read_collected(path) for path in sorted(Path(directory).rglob("*.mcap"))[: sizes.stock]]
    stock = StockCollector(one)
    starts: list[float] = []
    differences = _differences(stock, collected)
    contenders = {
        "ours": _rate(_config(sizes.ours, _WORKERS), starts),
        "ours, one worker": _rate(_config(sizes.one_worker, 1), []),
        "stock": _stock_rate(stock, collected),
    }
    rates = side_by_side(contenders, sizes.rounds)
    stock.close()
    return _outcome(rates, parts, differences | {"start of the processes (s)": median(starts)})


def _outcome(rates: dict[str, list[float]], parts: list[Part], figures: dict[str, float]) -> Outcome:
    spent = {part.name: part.milliseconds for part in parts}
    share = spent["writing MCAP"] / sum(spent.values())
    outcome = Outcome(
        benchmark="collect",
        compares=f"kept 64² frames/s on disk, {_WORKERS} workers, against stock stepping and rendering in one process",
        unit="kept frame in one process",
        targets=[
            Target("ours / stock", ratio(rates, "ours", "stock"), 10.0, "×"),
            Target("writing MCAP, share of the time", share, 0.05, at_least=False),
        ],
        figures={"ours with one worker / stock": ratio(rates, "ours, one worker", "stock")} | figures,
        parts=parts,
        cores=_WORKERS,
        rounds=rates,
        notes=["the start of the processes (imports, compiling the scene) is not in the rates"],
    )
    assert outcome.limit_ms is not None
    outcome.figures["fraction of the limit"] = outcome.limit_ms * median(rates["ours"]) * 1e-3
    return outcome


def _config(episodes: int, workers: int) -> CollectStageConfig:
    changes = (f"collect.episodes={episodes}", f"collect.workers={workers}")
    config = load_config("laptop", overrides=changes)
    return CollectStageConfig(world=config.world, camera=config.camera, collect=config.collect)


def _rate(config: CollectStageConfig, starts: list[float]) -> Rate:
    """Kept frames per second until all are durable; the time to the first episode is added to `starts` [s]."""

    def measured() -> float:
        clock, uncounted = _Clock(), _UNCOUNTED * config.collect.workers
        with tempfile.TemporaryDirectory() as directory:
            started = time.perf_counter()
            collect(config, Path(directory), dataset=_DATASET, progress=clock)
            ended = time.perf_counter()
        starts.append(clock.times[0] - started)
        episodes = config.collect.episodes - uncounted
        return episodes * frames_per_episode(config.collect) / (ended - clock.times[uncounted - 1])

    return measured


class _Clock(Silent):
    """Progress that notes when each episode was finished."""

    def __init__(self) -> None:
        self.times: list[float] = []

    @contextmanager
    def task(self, label: str, total: int, done: int = 0) -> Iterator["_Clock"]:
        yield self

    def advance(self, units: int = 1) -> None:
        self.times.append(time.perf_counter())

    def note(self, text: str) -> None:
        pass


def _stock_rate(stock: StockCollector, episodes: list[CollectedEpisode]) -> Rate:
    def measured() -> float:
        started = time.perf_counter()
        frames = sum(1 for episode in episodes for _ in stock.collect(episode))
        return frames / (time.perf_counter() - started)

    return measured


def _differences(stock: StockCollector, episodes: list[CollectedEpisode]) -> dict[str, float]:
    """Whether stock does and sees the same."""
    positions, pixels = [], []
    for episode in episodes:
        seen = zip(stock.collect(episode), episode.qpos.values(), episode.images, strict=True)
        for (image, qpos), our_qpos, our_image in seen:
            positions.append(np.abs(qpos - our_qpos).max())
            pixels.append(np.abs(image.astype(float) - our_image).mean())
    return {"largest difference of qpos": max(positions), "mean difference of the pixels (of 255)": np.mean(pixels)}


def _parts(config: CollectStageConfig, out: Path) -> list[Part]:
    """Where one process's time goes, per kept frame, with the limits of physics and rasterising."""
    (out / "episodes").mkdir()
    watch, collector = Stopwatch(), Collector(config, out, _DATASET)
    plans = plan_episodes(config.collect, "scripted")
    for plan in plans[:_UNCOUNTED]:
        collector.collect(plan)
    watch.wrap(collector._renderer, "render", "render")
    watch.wrap(collector._recorder, "record", "record")
    watch.wrap(collector, "_read", "read")
    for world in collector._worlds.values():
        watch.wrap(world, "step", "step")
    with watch.part("all"):
        for plan in plans[_UNCOUNTED:]:
            collector.collect(plan)
        with watch.part("durable"):
            make_durable(out / "episodes")
    frames = frames_per_episode(config.collect) * len(plans[_UNCOUNTED:])
    ms = {name: 1e3 * seconds / frames for name, seconds in watch.seconds.items()}
    steps_per_frame = config.collect.steps / frames_per_episode(config.collect)
    qpos = read_collected(out / plans[0].file).qpos[plans[0].kept_steps[0]]
    physics = steps_per_frame * roofline.mj_step_ms(collector._scene, qpos.tolist())
    raster = roofline.raster_ms(collector._renderer)
    collector.close()
    return [
        Part("physics and control", ms["step"], physics),
        Part("render", ms["render"], raster),
        Part("writing MCAP", ms["record"] - ms["render"] + ms["durable"]),
        Part("reading it back", ms["read"]),
        Part("behaviour and the rest", ms["all"] - ms["step"] - ms["record"] - ms["durable"] - ms["read"]),
    ]
