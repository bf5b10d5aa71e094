"""A matrix of runs, cell by cell."""

from collections import Counter
from itertools import product
from typing import NamedTuple

from schemas.errors import ConfigError
from stages.policy.config import MatrixConfig, RunConfig, Scheme
from stages.sim.config import MisalignmentKind, TaskName


class Cell(NamedTuple):
    """One run of a matrix: its identity and its configuration."""

    name: str
    task: TaskName
    scheme: Scheme
    misalignment_kind: MisalignmentKind
    misalignment_deg: float
    seed: int
    config: RunConfig

    @property
    def identity(self) -> dict[str, str | float | int]:
        """What tells the cell from its neighbours."""
        return {
            "task": self.task,
            "scheme": self.scheme,
            "misalignment_kind": self.misalignment_kind,
            "misalignment_deg": self.misalignment_deg,
            "seed": self.seed,
        }


def cell_name(task: str, scheme: str, kind: str, degrees: float, seed: int) -> str:
    """`reach-dense2sparse-pan05-seed0`; fractions of a degree as they are: `pan2.5`."""
    return f"{task}-{scheme}-{kind}{angle_name(degrees)}-seed{seed}"


def angle_name(degrees: float) -> str:
    """05 for 5°."""
    return f"{int(degrees):02d}" if float(degrees).is_integer() else f"{degrees:g}"


def cells(matrix: MatrixConfig) -> list[Cell]:
    """Every cell, tasks in order; each task with its own overrides. ConfigError when two have the same name."""
    found = [cell for task in matrix.tasks for cell in _cells_of_task(matrix.for_task(task), task)]
    name, count = Counter(cell.name for cell in found).most_common(1)[0]
    if count > 1:
        raise ConfigError(
            f"the matrix of [policy] holds {name} {count} times: name each task, scheme, angle, seed once"
        )
    return found


def _cells_of_task(matrix: MatrixConfig, task: TaskName) -> list[Cell]:
    config = RunConfig.model_validate(matrix.model_dump(include=set(RunConfig.model_fields)))
    kind = matrix.misalignment_kind
    return [
        Cell(cell_name(task, scheme, kind, degrees, seed), task, scheme, kind, degrees, seed, config)
        for scheme, degrees, seed in product(matrix.schemes, matrix.misalignment_degrees, matrix.seeds)
    ]
