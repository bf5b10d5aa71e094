"""The evidence: a report's results for the project's own history, small enough to commit, and a way to redo them.

Its tables of answers are what SQL says of the logs. Everything else in it follows from those and provenance.json.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import jinja2
from pydantic import BaseModel, ConfigDict

from schemas.files import write_bytes
from schemas.manifest import Code, Environment, InputRef
from stages.analyze import formats, paper, provenance
from stages.analyze.catalogue import Artifact
from stages.analyze.config import AnalyzeConfig
from stages.analyze.derived import Derived, derive, estimator_errors
from stages.analyze.figures import cameras
from stages.analyze.report import Contents
from stages.analyze.resolved import config_toml
from stages.analyze.results import Answer, Row
from stages.analyze.studies import Study
from stages.analyze.tables import read_answers
from stages.analyze.verdicts import RULES

README, PROVENANCE, CONFIG = "README.md", "provenance.json", "config.toml"
PARTS = (README, PROVENANCE, CONFIG, "tables", "figures")
"""What of a report is evidence."""

_ENOUGH = 10
"""Episodes in a region that are enough to name it."""


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
    inputs: list[InputRef]
    error: str | None  # why it failed


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
    artifacts: list[Record]
    environments: list[Environment]
    figures: list[Shown]

    @property
    def asked(self) -> list[Study]:
        """The studies."""
        return [Study(**study | {"keys": tuple(study["keys"]), "runs": tuple(study["runs"])}) for study in self.studies]


def write(contents: Contents, out: Path) -> None:
    """Write README.md, provenance.json and config.toml into `out`."""
    told = _provenance(contents)
    write_bytes((told.model_dump_json(indent=1) + "\n").encode(), out / PROVENANCE)
    write_bytes(config_toml(contents.config, contents.selection).encode(), out / CONFIG)
    write_bytes(_readme(told, contents.answers, contents.derived).encode(), out / README)


def recompute(directory: Path) -> tuple[dict[str, list[Row]], str]:
    """The derived tables by name, and README.md, as they follow from the answers and provenance.json in `directory`."""
    told = Provenance.model_validate_json((directory / PROVENANCE).read_bytes())
    answers = read_answers(directory / "tables")
    derived = derive(told.analysis, told.asked, answers)
    return derived.tables, _readme(told, answers, derived)


def _provenance(contents: Contents) -> Provenance:
    selection = contents.selection
    found = {artifact.id: artifact for artifact in [*_datasets(contents), *contents.shown]}
    environments = list(
        {a.manifest.environment.model_dump_json(): a.manifest.environment for a in found.values()}.values()
    )
    figures = [Shown(id=figure.id, title=figure.title, caption=figure.caption) for figure in contents.figures]
    if contents.cameras:
        figures.append(Shown(id=cameras.ID, title=cameras.TITLE, caption=cameras.CAPTION))
    return Provenance(
        analysis=contents.config,
        studies=[asdict(study) for study in selection.studies],
        artifacts=[_record(artifact, environments) for artifact in found.values()],
        environments=environments,
        figures=figures,
    )


def _datasets(contents: Contents) -> list[Artifact]:
    inputs = [reference.id for each in contents.selection.estimators for reference in each.manifest.inputs]
    return [contents.selection.sources[id] for id in inputs if id in contents.selection.sources]


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
        inputs=manifest.inputs,
        error=None if error is None else str(error),
    )


_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.PackageLoader("stages.analyze"),
    autoescape=False,  # Markdown
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_ENVIRONMENT.filters |= formats.FILTERS | {"cell": lambda text: str(text).replace("|", "\\|").replace("\n", " ")}


def _readme(told: Provenance, answers: Mapping[str, Answer], derived: Derived) -> str:
    confidence = f"{100 * told.analysis.confidence:g} %"
    runs = _rows(answers, "runs")
    return _ENVIRONMENT.get_template("evidence.md.j2").render(
        names=sorted({row["name"] for row in runs if row["main"]}),
        runs=runs,
        unfinished=[row for row in runs if row["status"] != "complete"],
        errors={record.id.removeprefix("runs/"): record.error for record in told.artifacts},
        groups=derived.groups,
        derived=derived,
        counts=_counts(derived),
        estimators=_rows(answers, "estimators"),
        estimator_errors=estimator_errors(answers),
        misalignments=_rows(answers, "estimator-misalignment"),
        correlations=_rows(answers, "region-correlation"),
        regions=_region_sentences(_rows(answers, "regions")),
        volume=next(iter(_rows(answers, "volume")), None),
        studies=told.asked,
        figures={figure.id: figure for figure in told.figures},
        limits=provenance.limits(derived.groups, [record.code for record in told.artifacts], paper.SEEDS),
        environments=[
            (sum(record.environment == i for record in told.artifacts), provenance.facts(environment))
            for i, environment in enumerate(told.environments)
        ],
        codes=_codes(told.artifacts),
        analysis=told.analysis,
        confidence=confidence,
        rules=RULES,
        paper=paper,
    )


def _rows(answers: Mapping[str, Answer], name: str) -> list[Row]:
    return answers[name].rows if name in answers else []


def _counts(derived: Derived) -> list[tuple[str, int]]:
    """How many claims have which verdict, those of a study's variant left out."""
    verdicts = [each.verdict for each in derived.claims if each.variant is None]
    order = ("reproduced", "not reproduced", "different", "not measured")
    return [(verdict, verdicts.count(verdict)) for verdict in order if verdict in verdicts]


def _codes(records: Sequence[Record]) -> list[tuple[str, int]]:
    """Versions of the code and how many artifacts each made."""
    said = [
        f"{record.code.version}, commit {record.code.git_commit or 'unknown'}"
        + (" with uncommitted changes" if record.code.dirty else "")
        for record in records
    ]
    return [(code, said.count(code)) for code in dict.fromkeys(said)]


def _region_sentences(rows: Sequence[Row]) -> list[str]:
    """For each setting of dense and dense2sparse the regions that lose most and least."""
    settings: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        known = row["lost_return"] is not None and isfinite(row["lost_return"]) and row["episodes"] >= _ENOUGH
        if row["scheme"] in ("dense", "dense2sparse") and known:
            key = (row["name"], row["task"], row["misalignment_kind"], row["misalignment_deg"], row["scheme"])
            settings.setdefault(key, []).append(row)
    return [_region_sentence(members) for members in settings.values() if len(members) > 1]


def _region_sentence(rows: Sequence[Row]) -> str:
    first = rows[0]
    most, least = (pick(rows, key=lambda row: row["lost_return"]) for pick in (max, min))
    where = f"{first['task']}, {formats.camera(first)}, {first['scheme']}"
    return f"{where}: most is lost at {_region(most)}, least at {_region(least)}."


def _region(row: Row) -> str:
    error = "no estimate" if row["estimation_error"] is None else f"estimate {100 * row['estimation_error']:.1f} cm off"
    return (
        f"x = {formats.signed(100 * row['x'], 0)} cm, y = {formats.signed(100 * row['y'], 0)} cm "
        f"({formats.figure(row['lost_return'])} of return, {error}, {row['episodes']} episodes)"
    )
