"""Verdicts on groups whose numbers one can check by hand."""

from dataclasses import replace
from typing import Any

import pytest

from stages.analyze.claims import CLAIMS, TARGETS, Claim, Setting
from stages.analyze.config import AnalyzeConfig
from stages.analyze.results import Group, Statistics, groups
from stages.analyze.verdicts import Judged, flat, judge, judge_variant

STATISTICS = Statistics(AnalyzeConfig(bootstrap_samples=500))
A, B = Setting("reach", 0, "dense2sparse"), Setting("reach", 0, "dense")
ABOVE = Claim("id", "a above b", "§", "above", "return", A, B)
KEEPS = Claim("id", "a keeps b", "§", "keeps", "return", A, B, value=0.95)
LEVEL = Claim("id", "a about 100", "§", "level", "return", A, value=100.0)


def group(scheme: str, returns: tuple[float, ...], failed: tuple[int, ...] = (), **changes: Any) -> Group:
    """A group of reach at 0° whose seeds 0, 1, … end at `returns`."""
    identity = {"name": "main", "task": "reach", "misalignment_kind": "orbit", "misalignment_deg": 0.0}
    common = identity | {"scheme": scheme, "buffer": "keep", "reset": "none"} | changes
    seeds = dict.fromkeys(range(len(returns)), "complete") | dict.fromkeys(failed, "failed")
    runs = [common | {"run": f"main/{seed}", "seed": seed, "status": status} for seed, status in seeds.items()]
    outcome = {"split": "final", "episodes": 200, "mean_steps_to_success": None, "mean_estimation_error": None}
    outcomes = [
        outcome | {"run": f"main/{seed}", "seed": seed, "mean_return": value, "success_rate": value / 200}
        for seed, value in enumerate(returns)
    ]
    (made,) = groups(runs, outcomes, [{"run": "main/0", "seed": 0, "area": 50.0}], STATISTICS)
    return made


def verdict(claim: Claim, *made: Group) -> Judged:
    (judged,) = judge([claim], made, {}, STATISTICS)
    return judged


@pytest.mark.parametrize(
    ("ours", "theirs", "expected"),
    [
        ((110.0, 121.0, 105.0), (100.0, 111.0, 95.0), "reproduced"),  # +10 for every seed, though the ranges overlap
        ((100.0, 111.0, 95.0), (110.0, 121.0, 105.0), "different"),
        ((110.0, 90.0, 105.0), (100.0, 100.0, 100.0), "not reproduced"),
        ((110.0,), (100.0,), "not reproduced"),  # one seed has no interval
    ],
)
def test_an_order_is_judged_by_the_interval_of_paired_differences(
    ours: tuple[float, ...], theirs: tuple[float, ...], expected: str
) -> None:
    judged = verdict(ABOVE, group("dense2sparse", ours), group("dense", theirs))
    assert judged.verdict == expected
    assert judged.effect == pytest.approx(sum(ours) / len(ours) - sum(theirs) / len(theirs))
    if len(ours) == 1:
        assert (judged.low, judged.note) == (None, "one seed has no interval")


def test_the_interval_of_equal_differences_is_that_difference() -> None:
    judged = verdict(ABOVE, group("dense2sparse", (110.0, 121.0)), group("dense", (100.0, 111.0)))
    assert (judged.seeds, judged.low, judged.high) == (2, 10.0, 10.0)


@pytest.mark.parametrize(
    ("ours", "expected"), [((95.0, 95.0), "reproduced"), ((94.0, 95.0), "not reproduced"), ((300.0,), "reproduced")]
)
def test_keeping_is_judged_by_the_ratio_of_means(ours: tuple[float, ...], expected: str) -> None:
    judged = verdict(KEEPS, group("dense2sparse", ours), group("dense", (100.0, 100.0)))
    assert judged.verdict == expected
    assert judged.effect == pytest.approx(sum(ours) / len(ours) / 100.0)


def test_nothing_keeps_of_nothing() -> None:
    assert verdict(KEEPS, group("dense2sparse", (0.0, 0.0)), group("dense", (0.0, 0.0))).verdict == "not reproduced"


@pytest.mark.parametrize(
    ("ours", "expected"),
    [
        ((91.0, 91.0), "reproduced"),  # 9 is less than 10 % of 91
        ((90.0, 90.0), "different"),  # 10 is more than 10 % of 90
        ((40.0, 120.0), "reproduced"),  # far off, but 100 is within 40 to 120
        ((85.0,), "different"),
    ],
)
def test_a_level_is_judged_by_the_interval_or_ten_percent(ours: tuple[float, ...], expected: str) -> None:
    assert verdict(LEVEL, group("dense2sparse", ours)).verdict == expected


def test_what_did_not_run_is_not_measured() -> None:
    assert verdict(ABOVE, group("dense2sparse", (1.0, 2.0))).verdict == "not measured"
    assert verdict(ABOVE).verdict == "not measured"
    apart = replace(group("dense", (100.0,)), scores=replace(group("dense", (1.0,)).scores, returns={5: 100.0}))
    assert verdict(ABOVE, group("dense2sparse", (100.0,)), apart).note == "no seed in common"


def test_where_every_run_failed_the_claim_is_not_reproduced() -> None:
    judged = verdict(ABOVE, group("dense2sparse", (), failed=(0, 1)), group("dense", (100.0, 90.0)))
    assert (judged.verdict, judged.failed) == ("not reproduced", 2)
    assert judged.note == "every run of dense2sparse at 0° failed"


def test_failed_runs_count() -> None:
    """Two seeds say +10, the third of dense2sparse diverged: with it at 0 the order is not shown."""
    ours, theirs = group("dense2sparse", (110.0, 110.0), failed=(2,)), group("dense", (100.0, 100.0, 100.0))
    judged = verdict(ABOVE, ours, theirs)
    assert (judged.verdict, judged.failed) == ("not reproduced", 1)
    assert judged.note == "reproduced without the failed runs, not reproduced with them counted as 0"
    reverse = replace(ABOVE, subject=B, rival=A)
    assert verdict(reverse, theirs, ours).verdict == "not reproduced"  # another's failure shows nothing either
    survived = verdict(ABOVE, group("dense2sparse", (110.0, 110.0, 110.0)), group("dense", (9.0, 9.0), failed=(2,)))
    assert (survived.verdict, survived.note) == ("reproduced", "the same with failed runs counted as 0")


def test_the_estimator_is_judged_by_each_that_was_used() -> None:
    claim = next(claim for claim in CLAIMS if claim.id == "estimator")
    judged = judge([claim], [], {"good": 0.014, "bad": 0.0141}, STATISTICS)
    assert [(each.name, each.verdict) for each in judged] == [("good", "reproduced"), ("bad", "not reproduced")]
    assert judge([claim], [], {}, STATISTICS)[0].verdict == "not measured"


def test_every_claim_has_an_id_of_its_own_and_its_place_in_the_paper() -> None:
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS)
    assert len({claim.id for claim in TARGETS}) == len(TARGETS)
    assert all(claim.source.startswith("§") and claim.paper for claim in CLAIMS)
    levels = {(c.subject.task, c.subject.misalignment_deg, c.subject.scheme, c.quantity): c.value
              for c in CLAIMS if c.rule == "level" and c.subject}  # fmt: skip
    assert levels["reach", 10, "sparse", "success"] == 0.33
    assert levels["lift", 0, "dense2sparse", "return"] == 350


def test_a_study_s_variant_stands_in_for_dense2sparse_alone() -> None:
    """At 10° only: claims that would mix it with dense2sparse of the main runs at 0° are left out."""
    at_10 = {"misalignment_deg": 10.0}
    main = [group("dense2sparse", (150.0, 150.0)), group("oracle", (180.0, 180.0), **at_10)]
    main += [group("dense2sparse", (100.0, 100.0), **at_10), group("dense", (90.0, 110.0), **at_10)]
    better = group("dense2sparse", (175.0, 177.0), **at_10, name="study-buffer-relabel", buffer="relabel")
    before = {each.claim.id: each.verdict for each in judge(CLAIMS, main, {}, STATISTICS)}
    judged = judge_variant(CLAIMS, main, [better], "buffer: relabel", STATISTICS)
    after = {each.claim.id: each.verdict for each in judged}
    assert before["reach-dense2sparse-oracle-10"] == "not reproduced"
    assert after["reach-dense2sparse-oracle-10"] == "reproduced"
    assert (before["reach-dense-below-dense2sparse-10"], after["reach-dense-below-dense2sparse-10"]) == (
        "not reproduced",
        "reproduced",
    )
    assert "reach-dense2sparse-unchanged-10-return" in before
    assert "reach-dense2sparse-unchanged-10-return" not in after
    assert {each.treatment for each in judged} == {"relabel, none"}
    assert {each.variant for each in judged} == {"buffer: relabel"}


def test_verdicts_as_rows() -> None:
    (row,) = flat([verdict(ABOVE, group("dense2sparse", (110.0, 121.0)), group("dense", (100.0, 111.0)))])
    assert (row["ours_mean"], row["rival_mean"], row["effect"], row["verdict"]) == (115.5, 105.5, 10.0, "reproduced")
