"""Where the numbers come from: lineage and environments."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.manifest import Environment, Manifest
from stages.analyze.catalogue import Artifact
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


def distinct(environments: Sequence[Environment]) -> list[Environment]:
    """Each environment once, in order."""
    return list({each.model_dump_json(): each for each in environments}.values())


def environments(of_artifacts: Sequence[Environment]) -> list[EnvironmentFacts]:
    """The distinct environments of the artifacts; several mean that machines may explain a difference."""
    counts = [(sum(each == other for other in of_artifacts), each) for each in distinct(of_artifacts)]
    return [EnvironmentFacts(f"{n} artifact{'s' * (n > 1)}", facts(each)) for n, each in counts]


def facts(environment: Environment) -> list[tuple[str, str]]:
    """What may explain a difference between machines, as names and values."""
    packages = [f"{name} {environment.packages[name]}" for name in _PACKAGES if name in environment.packages]
    return [
        ("Python", environment.python),
        ("Platform", environment.platform),
        ("CPU", environment.cpu),
        ("GPU", environment.gpu or "none"),
        ("GL renderer", environment.gl_renderer or "none"),
        *([("Networks on", environment.device)] if environment.device else []),
        ("Packages", ", ".join(packages) or "not recorded"),
    ]
