"""Timing side by side: contenders take turns, so that a ratio holds while the machine's speed drifts."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from statistics import median

Rate = Callable[[], float]
"""Does some work and returns how many units it did per second."""


def side_by_side(contenders: Mapping[str, Rate], rounds: int) -> dict[str, list[float]]:
    """Rates of each contender, one per round, after one round that is not counted."""
    rates: dict[str, list[float]] = {name: [] for name in contenders}
    for number in range(rounds + 1):
        for name, work in contenders.items():
            rate = work()
            if number:
                rates[name].append(rate)
    return rates


def ratio(rates: Mapping[str, list[float]], ours: str, theirs: str) -> float:
    """Median over the rounds of ours / theirs."""
    return median(a / b for a, b in zip(rates[ours], rates[theirs], strict=True))


def rate_of(work: Callable[[], object], units: int) -> Rate:
    """The rate of a function that does `units` of work in a call."""

    def measured() -> float:
        started = time.perf_counter()
        work()
        return units / (time.perf_counter() - started)

    return measured


def milliseconds(work: Callable[[], object], repetitions: int = 30) -> float:
    """Median time of a call [ms], after three that are not counted."""
    for _ in range(3):
        work()
    times = []
    for _ in range(repetitions):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return 1e3 * median(times)


class Stopwatch:
    """Adds up the wall time spent in named parts."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time of this block to the part."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started

    def wrap(self, holder: object, attribute: str, name: str) -> None:
        """Count the calls of an object's method to a part; the object serves the benchmark alone."""
        setattr(holder, attribute, self._timed(name, getattr(holder, attribute)))

    @contextmanager
    def wrapped(self, methods: Mapping[str, tuple[type, str]]) -> Iterator[None]:
        """Within this block, count the calls of these classes' methods to the parts they are named for."""
        originals = {name: getattr(holder, method) for name, (holder, method) in methods.items()}
        for name, (holder, method) in methods.items():
            setattr(holder, method, self._timed(name, originals[name]))
        try:
            yield
        finally:
            for name, (holder, method) in methods.items():
                setattr(holder, method, originals[name])

    def _timed(self, name: str, method: Callable[..., object]) -> Callable[..., object]:
        def timed(*args: object, **kwargs: object) -> object:
            with self.part(name):
                return method(*args, **kwargs)

        return timed
