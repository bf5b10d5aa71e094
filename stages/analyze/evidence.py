"""The evidence: a report's results for the project's own history, small enough to commit, and a way to redo them.

Its tables of answers are what SQL says of the logs. Everything else in it follows from those and provenance.json.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from schemas.files import write_bytes
from schemas.manifest import Code
from stages.analyze import endings, formats, paper, provenance, records
from stages.analyze.derived import Derived, derive, estimator_errors
from stages.analyze.limits import limits
from stages.analyze.records import Provenance
from stages.analyze.region_sentences import region_sentences
from stages.analyze.report import Contents
from stages.analyze.resolved import config_toml, of_inputs
from stages.analyze.results import Answer, Row, rows_of, total
from stages.analyze.rules import RULES
from stages.analyze.tables import read_answers

README, PROVENANCE, CONFIG = "README.md", "provenance.json", "config.toml"
PARTS = (README, PROVENANCE, CONFIG, "tables", "figures")
"""What of a report is evidence."""


def write(contents: Contents, out: Path) -> None:
    """Write README.md, provenance.json and config.toml into `out`."""
    write_told(records.of(contents), contents.answers, contents.derived, of_inputs(contents.selection), out)


def write_told(
    told: Provenance,
    answers: Mapping[str, Answer],
    derived: Derived,
    inputs: Mapping[str, dict[str, Any]],
    out: Path,
) -> None:
    """Write what is `told` of `answers`; `inputs` are the configuration's sections of what the runs descend from."""
    config = config_toml(told.analysis, told.asked, inputs, rows_of(answers, "runs"))
    write_bytes((told.model_dump_json(indent=1) + "\n").encode(), out / PROVENANCE)
    write_bytes(config.encode(), out / CONFIG)
    write_bytes(_readme(told, answers, derived).encode(), out / README)


def read_told(directory: Path) -> Provenance:
    """What the evidence in `directory` is from."""
    return Provenance.model_validate_json((directory / PROVENANCE).read_bytes())


def recompute(directory: Path) -> tuple[dict[str, list[Row]], str]:
    """The derived tables by name, and README.md, as they follow from the answers and provenance.json in `directory`."""
    told = read_told(directory)
    answers = read_answers(directory / "tables")
    derived = derive(told.analysis, told.asked, answers)
    return derived.tables, _readme(told, answers, derived)


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
    runs = rows_of(answers, "runs")
    makers = [each for artifact in told.artifacts for each in artifact.makers]
    return _ENVIRONMENT.get_template("evidence.md.j2").render(
        names=sorted({row["name"] for row in runs if row["main"]}),
        runs=runs,
        left_out=told.left_out,
        accumulated=told.accumulated,
        unfinished=[row for row in runs if row["status"] != "complete"],
        errors={record.id.removeprefix("runs/"): record.error for record in told.artifacts},
        groups=derived.groups,
        derived=derived,
        counts=_counts(derived),
        estimators=rows_of(answers, "estimators"),
        estimator_errors=estimator_errors(answers),
        misalignments=rows_of(answers, "estimator-misalignment"),
        correlations=rows_of(answers, "region-correlation"),
        ended=rows_of(answers, "endings"),
        endings=endings,
        regions=region_sentences(rows_of(answers, "regions")),
        episodes=total(answers, "volume", "episodes"),
        transitions=total(answers, "volume", "transitions"),
        studies=told.asked,
        figures={figure.id: figure for figure in told.figures},
        limits=limits(derived.groups, derived.of_studies, [each.code for each in makers], f"`{PROVENANCE}`"),
        environments=provenance.environments([told.environments[each.environment] for each in makers]),
        codes=_codes([each.code for each in makers]),
        analysis=told.analysis,
        confidence=confidence,
        rules=RULES,
        paper=paper,
    )


def _counts(derived: Derived) -> list[tuple[str, int]]:
    """How many claims have which verdict, those of a study's variant left out."""
    verdicts = [each.verdict for each in derived.claims if each.variant is None]
    order = ("reproduced", "not reproduced", "different", "not measured")
    return [(verdict, verdicts.count(verdict)) for verdict in order if verdict in verdicts]


def _codes(codes: Sequence[Code]) -> list[tuple[str, int]]:
    """Versions of the code and how many artifacts each made, or a part of."""
    said = [
        f"{code.version}, commit {code.git_commit or 'unknown'}" + (" with uncommitted changes" if code.dirty else "")
        for code in codes
    ]
    return [(code, said.count(code)) for code in dict.fromkeys(said)]
