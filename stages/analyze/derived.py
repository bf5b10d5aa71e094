"""Everything computed from the answers: groups, comparisons, verdicts, tables. A pure function, so it can be redone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stages.analyze import best as best_of
from stages.analyze import comparisons, results, studies, verdicts
from stages.analyze.comparisons import Comparison, Switch
from stages.analyze.config import AnalyzeConfig
from stages.analyze.deviations import deviations
from stages.analyze.findings import findings
from stages.analyze.paper import PaperResult
from stages.analyze.paper_claims import CLAIMS
from stages.analyze.results import Answer, Group, Row, rows_of
from stages.analyze.statistics import Statistics
from stages.analyze.studies import Study, Variant
from stages.analyze.targets import TARGETS
from stages.analyze.verdicts import Judged


@dataclass(frozen=True)
class Derived:
    """What the report and the evidence show."""

    groups: list[Group]
    switches: list[Switch]
    comparisons: list[Comparison]
    claims: list[Judged]
    targets: list[Judged]
    variants: list[Variant]
    best: list[tuple[Study, list[Variant]]]  # treatment at the switch, in every setting that it ran in
    study_sentences: dict[str, list[str]]  # by study
    findings: list[str]  # dense2sparse against dense
    deviations: list[str]  # from the paper's runs

    def best_beside(self, group: Group) -> list[Variant]:
        """The best treatment of dense2sparse in the setting of `group`, where a study has one."""
        mine = [variant for study, members in self.best if study.main == group.name for variant in members]
        return [variant for variant in mine if results.order(variant.group)[1:] == results.order(group)[1:]]

    @property
    def of_studies(self) -> list[Group]:
        """The variants' groups, without the main runs beside them."""
        return [variant.group for variant in self.variants if not variant.main]

    @property
    def tables(self) -> dict[str, list[Row]]:
        """The tables beside those of the answers, by name."""
        made = {
            "results": results.flat(self.groups),
            "paper": [_paper_row(row.paper, row.group) for row in self.comparisons],
            "claims": verdicts.flat(self.claims),
            "targets": verdicts.flat(self.targets),
        }
        return made | ({"studies": studies.flat(self.variants)} if self.variants else {})


def derive(config: AnalyzeConfig, asked: Sequence[Study], answers: Mapping[str, Answer]) -> Derived:
    """The derived part of an analysis of `answers` with the studies `asked`."""
    statistics = Statistics(config)
    main = [row for row in rows_of(answers, "runs") if row["main"]]
    groups = results.groups(main, rows_of(answers, "outcomes"), rows_of(answers, "learning-area"), statistics)
    errors = estimator_errors(answers)
    variants = studies.variants(rows_of(answers, "study-outcomes"), asked, statistics)
    claims = verdicts.judge(CLAIMS, groups, errors, statistics)
    targets = verdicts.judge(TARGETS, groups, errors, statistics)
    best = best_of.best_treatments(variants, asked)
    for study, members in best:
        beside = [group for group in groups if group.name == study.main]
        label, chosen = f"{study.name}: {members[0].label}", [member.group for member in members]
        claims += verdicts.judge_variant(CLAIMS, beside, chosen, label, statistics)
        targets += verdicts.judge_variant(TARGETS, beside, chosen, label, statistics)
    confidence = f"{100 * config.confidence:g} %"
    return Derived(
        groups=groups,
        switches=comparisons.switches(rows_of(answers, "switch-effect"), statistics),
        comparisons=comparisons.beside_paper(groups),
        claims=_in_order(claims),
        targets=_in_order(targets),
        variants=variants,
        best=best,
        study_sentences={
            study.name: best_of.sentences([v for v in variants if v.study == study.name], statistics, confidence)
            for study in asked
        },
        findings=findings(groups, statistics, confidence),
        deviations=deviations(main, _of_used(answers, "estimator-misalignment", errors)),
    )


def estimator_errors(answers: Mapping[str, Answer]) -> dict[str, float]:
    """Mean error [m] on test episodes of the estimators that the main runs used; of all where none used any."""
    used = {row["estimator"] for row in rows_of(answers, "runs") if row["main"] and row["estimator"]}
    rows = [row for row in rows_of(answers, "estimators") if row["test_mean_error"] is not None]
    chosen = [row for row in rows if row["estimator"] in used] or rows
    return {row["estimator"]: row["test_mean_error"] for row in chosen}


def _of_used(answers: Mapping[str, Answer], name: str, errors: Mapping[str, float]) -> list[Row]:
    """The rows on the estimators that have `errors`: those that the main runs used."""
    return [row for row in rows_of(answers, name) if row["estimator"] in errors]


def _in_order(judged: list[Judged]) -> list[Judged]:
    """The verdict with the best variant right below the one it is beside."""
    ids = list(dict.fromkeys(each.claim.id for each in judged))
    return sorted(judged, key=lambda each: ids.index(each.claim.id))


def _paper_row(paper: PaperResult, ours: Group | None) -> Row:
    return {
        "task": paper.task,
        "misalignment_deg": float(paper.misalignment_deg),
        "misalignment_kind": None if ours is None else ours.misalignment_kind,
        "scheme": paper.scheme,
        "name": None if ours is None else ours.name,
        "paper_return": None if paper.episode_return is None else float(paper.episode_return),
        "return": None if ours is None or ours.returns is None else ours.returns.mean,
        "paper_success_rate": paper.success_rate,
        "success_rate": None if ours is None or ours.success is None else ours.success.mean,
        "seeds": 0 if ours is None else len(ours.seeds),
        "source": paper.source,
    }
