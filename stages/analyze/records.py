"""provenance.json: what an evidence is from, enough to redo what follows from its answers."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from schemas.manifest import Code, Environment, InputRef
from stages.analyze import provenance
from stages.analyze.catalogue import Artifact
from stages.analyze.config import AnalyzeConfig
from stages.analyze.figures import cameras
from stages.analyze.figures.figure import Figure
from stages.analyze.report import Contents
from stages.analyze.studies import Study


class Maker(BaseModel):
    """What made a part of an artifact."""

    model_config = ConfigDict(extra="forbid")
    code: Code
    environment: int  # place in the list of environments


class Record(BaseModel):
    """One artifact as it was when its logs were asked."""

    model_config = ConfigDict(extra="forbid")
    id: str
    status: str
    created_at: str
    manifest_sha256: str
    config_sha256: str
    code: Code
    environment: int  # place in the list of environments
    resumed_from: list[Maker] = []  # what began it, where that was not what ended it
    inputs: list[InputRef]
    error: str | None  # why it failed

    @property
    def makers(self) -> list[Maker]:
        """Everything that made a part of it, what ended it last."""
        return [*self.resumed_from, Maker(code=self.code, environment=self.environment)]

    def moved(self, of: Sequence[Environment], to: Sequence[Environment]) -> "Record":
        """The same with its places in another list of environments."""
        resumed = [
            maker.model_copy(update={"environment": to.index(of[maker.environment])}) for maker in self.resumed_from
        ]
        return self.model_copy(update={"environment": to.index(of[self.environment]), "resumed_from": resumed})


class Shown(BaseModel):
    """A figure of the evidence: figures/ID.png and ID.svg."""

    model_config = ConfigDict(extra="forbid")
    id: str
    title: str
    caption: str


class Provenance(BaseModel):
    """Where the answers come from, how they are analysed, and which figures were drawn."""

    model_config = ConfigDict(extra="forbid")
    analysis: AnalyzeConfig
    studies: list[dict[str, Any]]
    left_out: dict[str, int] = {}  # NAME of runs: how many were not finished
    accumulated: bool = False  # over several sittings
    artifacts: list[Record]
    environments: list[Environment]
    figures: list[Shown]

    @property
    def asked(self) -> list[Study]:
        """The studies."""
        return [Study(**study | {"keys": tuple(study["keys"]), "runs": tuple(study["runs"])}) for study in self.studies]


def of(contents: Contents) -> Provenance:
    """What provenance.json says of a report."""
    selection = contents.selection
    found = {artifact.id: artifact for artifact in [*selection.datasets, *contents.shown]}
    environments = provenance.distinct(
        [origin.environment for artifact in found.values() for origin in artifact.manifest.origins]
    )
    return Provenance(
        analysis=contents.config,
        studies=[asdict(study) for study in selection.studies],
        left_out=dict(contents.left_out),
        artifacts=[_record(artifact, environments) for artifact in found.values()],
        environments=environments,
        figures=shown(contents.drawn.every, contents.cameras),
    )


def shown(figures: Sequence[Figure], views: Sequence[Path]) -> list[Shown]:
    """What is said of `figures`, and of the camera's where it has `views`."""
    listed = [Shown(id=figure.id, title=figure.title, caption=figure.caption) for figure in figures]
    return [*listed, *([Shown(id=cameras.ID, title=cameras.TITLE, caption=cameras.CAPTION)] if views else [])]


def together(earlier: Provenance, later: Provenance) -> Provenance:
    """Both as one: a run has its later record; what runs descend from is there as often as it was made for them.

    Analysis and figures are those of `later`; a study of both has the variants of both; a NAME's unfinished runs are
    those of the later sitting that had any of it.
    """
    environments = provenance.distinct([*earlier.environments, *later.environments])
    runs = ids_of_runs(later.artifacts)
    placed = [
        *(record.moved(earlier.environments, environments) for record in without(earlier.artifacts, runs)),
        *(record.moved(later.environments, environments) for record in later.artifacts),
    ]
    names = {id.split("/")[1] for id in runs}
    return later.model_copy(
        update={
            "studies": _studies(earlier.studies, later.studies),
            "left_out": {name: n for name, n in earlier.left_out.items() if name not in names} | later.left_out,
            "artifacts": list({(record.id, record.manifest_sha256): record for record in placed}.values()),
            "environments": environments,
            "accumulated": True,
        }
    )


def ids_of_runs(records: Sequence[Record]) -> set[str]:
    """The runs among the records."""
    return {record.id for record in records if record.id.startswith("runs/")}


def without(records: Sequence[Record], runs: Set[str]) -> list[Record]:
    """Without these runs, and without what only they descend from, other runs excepted."""
    by_pin = {(record.id, record.manifest_sha256): record for record in records}
    kept = [record for record in records if record.id not in runs]
    others = ids_of_runs(kept)
    gone = _ancestors([record for record in records if record.id in runs], by_pin)
    gone -= _ancestors([record for record in kept if record.id in others], by_pin)
    return [record for record in kept if record.id in others or (record.id, record.manifest_sha256) not in gone]


def _ancestors(records: Sequence[Record], by_pin: Mapping[tuple[str, str], Record]) -> set[tuple[str, str]]:
    """Ids and hashes of all that these descend from."""
    pins = {(ref.id, ref.manifest_sha256) for record in records for ref in record.inputs}
    return pins | _ancestors([by_pin[pin] for pin in pins if pin in by_pin], by_pin) if pins else pins


def _studies(earlier: Sequence[dict[str, Any]], later: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    found = {study["name"]: study for study in earlier}
    for study in later:
        before = found.get(study["name"], study)
        found[study["name"]] = study | {"runs": list(dict.fromkeys([*before["runs"], *study["runs"]]))}
    return list(found.values())


def _record(artifact: Artifact, environments: Sequence[Environment]) -> Record:
    manifest = artifact.manifest
    error = manifest.summary.get("error")
    return Record(
        id=artifact.id,
        status=manifest.status,
        created_at=manifest.created_at,
        manifest_sha256=artifact.manifest_sha256,
        config_sha256=manifest.config_sha256,
        code=manifest.code,
        environment=environments.index(manifest.environment),
        resumed_from=[
            Maker(code=before.code, environment=environments.index(before.environment))
            for before in manifest.resumed_from
        ],
        inputs=manifest.inputs,
        error=None if error is None else str(error),
    )
