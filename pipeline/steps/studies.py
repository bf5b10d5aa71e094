"""The studies of a configuration: which of their runs to train, and which are there to report on."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.artifacts.inputs import load
from pipeline.artifacts.names import existing_ids
from pipeline.config import TASKS, PipelineConfig, Variant, variants
from pipeline.matrix import cells
from pipeline.steps.policy import Matrix
from pipeline.steps.session import Session
from pipeline.studies import ALL, logged_keys
from schemas.errors import ConfigError, unknown_choice
from stages.analyze.studies import Study

FINISHED = ("complete", "failed")
"""A failed run is finished: that it failed is a result."""
ABSENT = "absent"


class LeftOut(NamedTuple):
    """Runs of one NAME that a report leaves out."""

    id: str  # runs/NAME
    unfinished: int
    of: int
    left_out: int
    """The unfinished ones of a matrix; of a study's variant all, for its average would be over fewer runs."""

    def __str__(self) -> str:
        what = "the variant is" if self.left_out > self.unfinished else "they are"
        return f"{self.unfinished} of {self.of} runs are not finished: {what} left out of the report"

    def planned(self) -> dict[str, str]:
        """For `--dry-run`."""
        return {"id": self.id, "plan": str(self)}


def chosen(config: PipelineConfig, names: Sequence[str]) -> list[Variant]:
    """The variants of the studies named, in the configuration's order; `all` names every study."""
    valid = [*config.studies, ALL] if config.studies else []
    for name in names:
        if not valid:
            raise ConfigError(f"no study {name!r}: this configuration has no section [studies.NAME]")
        if name not in valid:
            raise ConfigError(unknown_choice("study", name, valid))
    return [v for study in config.studies if {study, ALL} & set(names) for v in variants(config, study)]


def matrices(session: Session, base: str, of: Sequence[Variant]) -> list[Matrix]:
    """The matrix of each variant, with its own configuration."""
    return [Matrix(replace(session, config=variant.config), variant.run(base)) for variant in of]


@dataclass(frozen=True)
class Reported:
    """What the studies add to a report."""

    studies: list[Study]
    runs: list[str]  # ids of their cells
    left_out: list[LeftOut]

    def as_config(self) -> dict[str, Any]:
        """For the report's manifest; empty without studies."""
        told = [{**asdict(each), "keys": list(each.keys), "runs": list(each.runs)} for each in self.studies]
        return {"studies": told} if told else {}


def finished(session: Session, base: str) -> Reported:
    """Every study beside the matrix `base` of which at least one variant is finished, with those variants."""
    reported = Reported([], [], [])
    for name, study in session.config.studies.items():
        states = {v.run(base): _statuses(session.root, v, base) for v in variants(session.config, name)}
        complete = [run for run, statuses in states.items() if set(statuses.values()) <= set(FINISHED)]
        if complete:
            keys = logged_keys(study, TASKS)
            reported.studies.append(Study(name, study.question, keys, tuple(complete), base))
        for run, statuses in states.items():
            if run in complete:
                reported.runs.extend(statuses)
            elif complete or set(statuses.values()) != {ABSENT}:
                unfinished = sum(status not in FINISHED for status in statuses.values())
                reported.left_out.append(LeftOut(f"runs/{run}", unfinished, len(statuses), len(statuses)))
    return reported


def _statuses(root: Path, variant: Variant, base: str) -> dict[str, str]:
    """Status of every cell that the variant is to have, and of what else is there under its NAME."""
    run = variant.run(base)
    wanted = {f"runs/{run}/{cell.name}": ABSENT for cell in cells(variant.config.policy)}
    there = {each: load(root, each).status for each in existing_ids(root, "runs") if each.startswith(f"runs/{run}/")}
    return {**wanted, **there}
