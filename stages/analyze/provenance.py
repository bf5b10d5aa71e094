"""Where the numbers come from: lineage, environments, and what so few seeds can show."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from schemas.manifest import Code, Environment, Manifest
from stages.analyze.catalogue import Artifact
from stages.analyze.results import Group, misalignment
from stages.analyze.statistics import Summary, distinct_resamples
from stages.analyze.study import Selection

_PACKAGES = ("torch", "mujoco", "robosuite", "numpy", "pyarrow", "duckdb")


@dataclass(frozen=True)
class InputState:
    """An input as pinned, and whether the artifact of that name is still the one."""

    id: str
    sha256: str
    state: str  # unchanged | changed since | gone


@dataclass(frozen=True)
class Lineage:
    """One row of the table of artifacts."""

    id: str
    status: str
    created_at: str
    sha256: str
    code: str
    inputs: list[InputState]


def lineage(selection: Selection) -> list[Lineage]:
    """The artifacts analysed and everything they were made from, inputs first."""
    chosen: dict[str, Artifact] = {}
    for artifact in [*selection.estimators, *selection.every_run]:
        _with_inputs(artifact, selection.sources, chosen)
    return [_row(artifact, selection.sources) for artifact in chosen.values()]


def _with_inputs(artifact: Artifact, sources: dict[str, Artifact], chosen: dict[str, Artifact]) -> None:
    if artifact.id in chosen:
        return
    for reference in artifact.manifest.inputs:
        if reference.id in sources and reference.id != artifact.id:
            _with_inputs(sources[reference.id], sources, chosen)
    chosen[artifact.id] = artifact


def _row(artifact: Artifact, sources: dict[str, Artifact]) -> Lineage:
    manifest = artifact.manifest
    inputs = [
        InputState(i.id, i.manifest_sha256, _state(i.manifest_sha256, sources.get(i.id))) for i in manifest.inputs
    ]
    return Lineage(
        artifact.id,
        manifest.status,
        manifest.created_at[:16].replace("T", " "),
        artifact.manifest_sha256,
        _code(manifest),
        inputs,
    )


def _state(pinned: str, source: Artifact | None) -> str:
    if source is None:
        return "gone"
    return "unchanged" if source.manifest_sha256 == pinned else "changed since"


def _code(manifest: Manifest) -> str:
    commit = f" {manifest.code.git_commit[:8]}" if manifest.code.git_commit else ""
    return f"{manifest.code.version}{commit}{' + changes' if manifest.code.dirty else ''}"


@dataclass(frozen=True)
class EnvironmentFacts:
    """One machine and set of packages, and how many artifacts were made with it."""

    title: str
    facts: list[tuple[str, str]]


def environments(artifacts: Sequence[Artifact]) -> list[EnvironmentFacts]:
    """The distinct environments of the artifacts; several mean that machines may explain a difference."""
    found: dict[str, list[Artifact]] = {}
    for artifact in artifacts:
        found.setdefault(artifact.manifest.environment.model_dump_json(), []).append(artifact)
    return [
        EnvironmentFacts(f"{len(members)} artifact{'s' * (len(members) > 1)}", facts(members[0].manifest.environment))
        for members in found.values()
    ]


def facts(environment: Environment) -> list[tuple[str, str]]:
    """What may explain a difference between machines, as names and values."""
    packages = [f"{name} {environment.packages[name]}" for name in _PACKAGES if name in environment.packages]
    return [
        ("Python", environment.python),
        ("Platform", environment.platform),
        ("CPU", environment.cpu),
        ("GPU", environment.gpu or "none"),
        ("GL renderer", environment.gl_renderer or "none"),
        ("Packages", ", ".join(packages) or "not recorded"),
    ]


def findings(groups: Sequence[Group], confidence: str) -> list[str]:
    """dense2sparse against dense in every setting that has both, said no more strongly than the intervals allow."""
    settings: dict[tuple[Any, ...], dict[str, Group]] = {}
    for group in groups:
        key = (group.name, group.task, group.misalignment_kind, group.misalignment_deg)
        settings.setdefault(key, {})[group.scheme] = group
    several = len({group.name for group in groups}) > 1
    lines = []
    for members in settings.values():
        ours, rival = members.get("dense2sparse"), members.get("dense")
        if ours and rival and ours.returns and rival.returns:
            lines.append(_finding(ours, ours.returns, rival.returns, confidence, several))
    return lines


def _finding(ours: Group, a: Summary, b: Summary, confidence: str, several: bool) -> str:
    where = f"{ours.task}, {misalignment(ours.misalignment_kind, ours.misalignment_deg)}"
    where += f" ({ours.name})" if several else ""
    said = f"{where}: dense2sparse ends at {a.mean:.1f}, dense at {b.mean:.1f}"
    if a.low is None or a.high is None or b.low is None or b.high is None:
        return f"{said}; one seed on a side, so nothing is known about the spread."
    apart = a.low > b.high or b.low > a.high
    return f"{said}; their {confidence} intervals {'do not overlap' if apart else 'overlap'}."


def limits(groups: Sequence[Group], codes: Sequence[Code], paper_seeds: int) -> list[str]:
    """What these logs cannot show, computed from them; `codes` made the artifacts."""
    judged = [group for group in groups if group.seeds]
    if not judged:
        return ["No run has been evaluated yet: nothing can be concluded about the schemes."]
    return [*_seed_limits(judged, paper_seeds), *_evaluation_limits(judged), *_run_limits(groups, codes)]


def _seed_limits(judged: Sequence[Group], paper_seeds: int) -> list[str]:
    counts = [len(group.seeds) for group in judged]
    few, many = min(counts), max(counts)
    said = f"{few} seed{'s' * (few > 1)}" if few == many else f"{few} to {many} seeds"
    lines = [f"Each group has {said} (the paper: {paper_seeds})."]
    if few == 1:
        lines.append("With one seed there is no spread and no interval: a difference between schemes may be luck.")
    if many > 1:
        lines.append(
            f"With {many} seeds the bootstrap has {distinct_resamples(many):,} distinct resamples; below about ten "
            "seeds its intervals are too narrow, so read overlap as “not shown” and a gap as a hint, not a proof."
        )
    return lines


def _evaluation_limits(judged: Sequence[Group]) -> list[str]:
    lines = []
    fewest = min(group.episodes for group in judged)
    if fewest:
        error = 100.0 * sqrt(0.25 / fewest)
        lines.append(
            f"The smallest evaluation has {fewest:,} episodes: the success rate of one run is known to about "
            f"± {error:.1f} percentage points (one standard error at 50 %)."
        )
    early = [group for group in judged if "eval" in group.judged_by.split(", ")]
    if early:
        lines.append(
            f"{len(early)} of {len(judged)} groups have runs without a final evaluation; those are judged by their "
            "last evaluation while training."
        )
    return lines


def _run_limits(groups: Sequence[Group], codes: Sequence[Code]) -> list[str]:
    lines = []
    running, failed = sum(group.running for group in groups), sum(group.failed for group in groups)
    if running:
        lines.append(f"{running} run{'s' * (running > 1)} still training: the numbers are as of now.")
    if failed:
        lines.append(
            f"{failed} run{'s' * (failed > 1)} failed: left out of the means, counted as 0 where a claim is judged."
        )
    if len({code.git_commit for code in codes}) > 1:
        lines.append("The artifacts were made by more than one version of the code (see the lineage).")
    if any(code.dirty for code in codes):
        lines.append("Some artifacts were made by code with uncommitted changes (see the lineage).")
    return lines
