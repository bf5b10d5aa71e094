"""What the logs cannot show, computed from them."""

from collections.abc import Sequence
from math import sqrt

from schemas.manifest import Code
from stages.analyze.paper import SEEDS
from stages.analyze.results import Group
from stages.analyze.statistics import distinct_resamples


def limits(groups: Sequence[Group], of_studies: Sequence[Group], codes: Sequence[Code], lineage: str) -> list[str]:
    """Of the main matrix and of the studies' variants beside it; `codes` made the artifacts, `lineage` says where."""
    every = [*groups, *of_studies]
    judged = [group for group in every if group.seeds]
    about = [*_seed_limits(judged), *_evaluation_limits(groups, of_studies)] if judged else [_NOTHING]
    return [*about, *_run_limits(groups, of_studies), *_code_limits(codes, lineage)]


_NOTHING = "No run has been evaluated yet: nothing can be concluded about the schemes."


def _seed_limits(judged: Sequence[Group]) -> list[str]:
    counts = [len(group.seeds) for group in judged]
    few, many = min(counts), max(counts)
    said = f"{few} seed{'s' * (few > 1)}" if few == many else f"{few} to {many} seeds"
    lines = [f"Each group has {said} (the paper: {SEEDS})."]
    if few == 1:
        lines.append("With one seed there is no spread and no interval: a difference between schemes may be luck.")
    if many > 1:
        lines.append(
            f"With {many} seeds the bootstrap has {distinct_resamples(many):,} distinct resamples; below about ten "
            "seeds its intervals are too narrow, so read overlap as “not shown” and a gap as a hint, not a proof."
        )
    return lines


def _evaluation_limits(groups: Sequence[Group], of_studies: Sequence[Group]) -> list[str]:
    lines = [
        f"The smallest evaluation of {whose} has {fewest:,} episodes: the success rate of one run is known to about "
        f"± {100.0 * sqrt(0.25 / fewest):.1f} percentage points (one standard error at 50 %)."
        for whose, some in (("the main runs", groups), ("the studies", of_studies))
        if (fewest := min((group.episodes for group in some if group.seeds), default=0))
    ]
    judged = [group for group in [*groups, *of_studies] if group.seeds]
    early = [group for group in judged if "eval" in group.judged_by.split(", ")]
    if early:
        lines.append(
            f"{len(early)} of {len(judged)} groups have runs without a final evaluation; those are judged by their "
            "last evaluation while training."
        )
    return lines


def _run_limits(groups: Sequence[Group], of_studies: Sequence[Group]) -> list[str]:
    every, lines = [*groups, *of_studies], []
    running, failed = sum(group.running for group in every), sum(group.failed for group in every)
    if running:
        lines.append(f"{running} run{'s' * (running > 1)} still training: the numbers are as of now.")
    if failed:
        beside = sum(group.failed for group in of_studies)
        lines.append(
            f"{failed} run{'s' * (failed > 1)} failed{f', {beside} of them of the studies' if beside else ''}: left "
            "out of the means, counted as 0 where a claim is judged and where variants are ranked."
        )
    return lines


def _code_limits(codes: Sequence[Code], lineage: str) -> list[str]:
    lines = []
    if len({code.git_commit for code in codes}) > 1:
        lines.append(f"The artifacts were made by more than one version of the code (see {lineage}).")
    if any(code.dirty for code in codes):
        lines.append(f"Some artifacts were made by code with uncommitted changes (see {lineage}).")
    return lines
