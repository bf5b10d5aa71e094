"""The report: one HTML file that opens offline, with everything it needs inside."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stages.analyze import endings, page, paper, provenance
from stages.analyze.behind import Recording
from stages.analyze.catalogue import Artifact
from stages.analyze.config import AnalyzeConfig
from stages.analyze.derived import Derived
from stages.analyze.drawn import Drawn
from stages.analyze.figures import cameras
from stages.analyze.limits import limits
from stages.analyze.results import Answer, rows_of
from stages.analyze.rules import RULES
from stages.analyze.study import Selection
from stages.analyze.tiles import tiles


@dataclass(frozen=True)
class Contents:
    """Everything the report shows."""

    config: AnalyzeConfig
    selection: Selection
    answers: dict[str, Answer]
    derived: Derived
    drawn: Drawn
    recordings: list[Recording]
    cameras: list[Path]
    left_out: Mapping[str, int]  # NAME of runs: how many were not finished

    @property
    def shown(self) -> list[Artifact]:
        """Every artifact that a number of the report is from."""
        return [*self.selection.estimators, *self.selection.every_run]


def render(contents: Contents) -> str:
    """The report as HTML. Names of artifacts are data, so they are escaped wherever they appear."""
    policy_sections = [
        {"id": "curves", "title": "Learning curves", "figures": contents.drawn.curves},
        {"id": "success", "title": "Success", "figures": contents.drawn.success},
        {"id": "reward-errors", "title": "Reward error", "figures": contents.drawn.errors},
    ]
    groups = contents.derived.groups
    confidence = f"{100 * contents.config.confidence:g} %"
    return page.render(
        "report.html.j2",
        contents.drawn.every,
        title=_title(contents.selection),
        sections=_sections(contents, policy_sections),
        tiles=tiles(contents.selection, contents.derived, contents.answers),
        findings=contents.derived.findings,
        left_out=contents.left_out,
        groups=groups,
        several_names=len({group.name for group in groups}) > 1,
        failed=[run for run in contents.selection.every_run if run.manifest.status == "failed"],
        estimators=rows_of(contents.answers, "estimators"),
        estimator_figures=contents.drawn.estimator,
        policy_sections=policy_sections,
        switches=contents.derived.switches,
        best_beside=contents.derived.best_beside,
        claims=contents.derived.claims,
        targets=contents.derived.targets,
        rules=RULES,
        studies=_studies(contents),
        region_figures=contents.drawn.regions,
        ended=rows_of(contents.answers, "endings"),
        endings=endings,
        correlations=rows_of(contents.answers, "region-correlation"),
        comparisons=contents.derived.comparisons,
        cameras=[{"title": cameras.title(path), "uri": _data_uri(path)} for path in contents.cameras],
        recordings=[recording for recording in contents.recordings if recording.error is None],
        limits=_limits(contents),
        deviations=contents.derived.deviations,
        lineage=provenance.lineage(contents.selection),
        environments=provenance.environments(
            [origin.environment for artifact in contents.shown for origin in artifact.manifest.origins]
        ),
        settings=[(key.replace("_", " "), value) for key, value in contents.config.model_dump().items()],
        sql={name.replace("-", "_"): answer.sql for name, answer in contents.answers.items()},
        confidence=confidence,
        bootstrap_samples=f"{contents.config.bootstrap_samples:,}",
        paper=paper,
    )


def _title(selection: Selection) -> str:
    names = sorted({run.name.split("/")[0] for run in selection.runs}) or [e.name for e in selection.estimators]
    return ", ".join(names)


def _sections(contents: Contents, policy: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    present = [
        ("summary", "Summary", True),
        ("estimator", "Estimator", contents.drawn.estimator),
        ("cameras", "Camera settings", contents.cameras),
        *((section["id"], section["title"], section["figures"]) for section in policy),
        ("endings", "Endings", rows_of(contents.answers, "endings")),
        ("regions", "Regions of the table", contents.drawn.regions),
        ("switch", "Effect of the switch", contents.derived.switches),
        ("claims", "The paper's claims", contents.derived.groups),
        ("studies", "Studies", contents.selection.studies),
        ("paper", "Paper beside ours", True),
        ("recordings", "Recordings", any(recording.error is None for recording in contents.recordings)),
        ("limits", "What can be concluded", True),
        ("lineage", "Artifacts", True),
        ("environment", "Environment", True),
    ]
    return [(id, label) for id, label, there in present if there]


def _studies(contents: Contents) -> list[dict[str, Any]]:
    """Each study with its variants, what they say, and its figure."""
    figures = {figure.id: figure for figure in contents.drawn.studies}
    return [
        {
            "study": study,
            "variants": [each for each in contents.derived.variants if each.study == study.name],
            "sentences": contents.derived.study_sentences[study.name],
            "figure": figures.get(f"study-{study.name}"),
        }
        for study in contents.selection.studies
    ]


def _limits(contents: Contents) -> list[str]:
    manifests = [artifact.manifest for artifact in contents.shown]
    codes = [origin.code for each in manifests for origin in each.origins]
    derived = contents.derived
    lines = limits(derived.groups, derived.of_studies, codes, "the lineage")
    return lines + [f"No recording of {r.note}: {r.error}" for r in contents.recordings if r.error is not None]


def _data_uri(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()
