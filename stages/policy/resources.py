"""What the machine lends to the training; results do not depend on it but for rounding on another device."""

from dataclasses import dataclass

from stages.sim.processes import available_cores


@dataclass(frozen=True)
class Share:
    """What each of the training's processes may use."""

    device: str
    processes: int
    workers: int
    threads: int

    @property
    def overlap(self) -> bool:
        """Whether updates have something to run beside: worlds in other processes, or networks on a GPU."""
        return self.workers > 0 or self.device == "cuda"


@dataclass(frozen=True)
class Resources:
    """As the user asks; None: as suits the machine."""

    device: str = "cpu"
    processes: int | None = None
    """Processes that train a part of the runs each."""
    workers: int | None = None
    """Processes that simulate for each of them; 0: it simulates itself."""
    threads: int | None = None
    """CPU threads of each one's networks."""

    def share(self, runs: int) -> Share:
        """For a number of runs in lockstep: a process per core on CPUs, for runs need nothing of each other.

        A GPU serves all runs at once, so there one process trains and the cores simulate.
        """
        cores = available_cores()
        processes = self.processes or (1 if self.device == "cuda" else cores)
        processes = min(processes, runs)
        spare = cores // processes  # cores of each process
        workers = self.workers if self.workers is not None else (spare if spare > 1 else 0)
        most = -(-runs // processes)  # runs of the process that has most
        return Share(self.device, processes, min(workers, most), self.threads or max(1, spare))
