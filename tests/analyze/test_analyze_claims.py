"""Which claims there are, and verdicts where runs failed, are missing, or a study's stand in for them."""

from dataclasses import replace

import pytest

from stages.analyze.findings import findings
from stages.analyze.paper_claims import CLAIMS
from stages.analyze.targets import TARGETS
from stages.analyze.verdicts import flat, judge, judge_variant
from tests.analyze.fake_groups import ABOVE, STATISTICS, A, B, group, verdict


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


def test_the_paper_compares_with_the_oracle_only_where_it_says_so() -> None:
    with_oracle = {
        (c.subject.task, c.subject.misalignment_deg, c.rule, c.paper)
        for c in CLAIMS
        if c.subject and c.rival and "oracle" in (c.subject.scheme, c.rival.scheme)
    }
    assert with_oracle == {
        ("reach", 0, "above", "“slightly higher”"),
        ("reach", 0, "above", "“much lower than other ablations”"),
        ("lift", 0, "keeps", "“nearly equals”"),
        ("lift", 0, "above", "“much lower”"),
    }
    shares = [t.subject.misalignment_deg for t in TARGETS if t.rival and t.subject]
    assert shares == [0, 5, 10]


def test_what_the_text_claims_is_there() -> None:
    ids = {claim.id for claim in CLAIMS}
    assert {f"reach-sparse-below-dense-{degrees}" for degrees in (0, 5, 10)} <= ids
    assert {f"reach-sparse-below-dense2sparse-{degrees}-success" for degrees in (5, 10)} <= ids
    assert {"reach-sparse-falls-5-success", "reach-sparse-falls-10-success"} <= ids
    assert {"reach-sparse-slower-dense2sparse", "reach-dense-converges-like-dense2sparse"} <= ids
    assert {"lift-dense-spread", "lift-sparse-spread"} <= ids


@pytest.mark.parametrize(
    ("theirs", "said"),
    [
        ((100.0, 111.0, 95.0), "higher"),  # +10 for every seed, though the ranges overlap
        ((120.0, 131.0, 115.0), "lower"),
        ((110.0, 151.0, 85.0), "not shown to differ"),
    ],
)
def test_findings_say_what_the_claims_do(theirs: tuple[float, ...], said: str) -> None:
    made = [group("dense2sparse", (110.0, 121.0, 105.0)), group("dense", theirs)]
    (sentence,) = findings(made, STATISTICS, "95 %")
    assert sentence.startswith("reach, 0°: dense2sparse ends at 112.0, dense at ")
    assert sentence.endswith(f"3 seeds in common), {said}.")
    claim = next(claim for claim in CLAIMS if claim.id == "reach-dense-below-dense2sparse-0")
    verdicts = {"reproduced": "higher", "different": "lower", "not reproduced": "not shown to differ"}
    assert verdicts[judge([claim], made, {}, STATISTICS)[0].verdict] == said


def test_findings_count_failed_runs() -> None:
    made = [group("dense2sparse", (110.0, 110.0), failed=(2,)), group("dense", (100.0, 100.0, 100.0))]
    (sentence,) = findings(made, STATISTICS, "95 %")
    assert "not shown to differ (1 failed: reproduced without the failed runs, not reproduced" in sentence


def test_a_study_s_variant_stands_in_for_dense2sparse_alone() -> None:
    """At 10° only: claims that would mix it with dense2sparse of the main runs at 0° are left out."""
    at_10 = {"misalignment_deg": 10.0}
    main = [group("dense2sparse", (150.0, 150.0)), group("oracle", (180.0, 180.0), **at_10)]
    main += [group("dense2sparse", (100.0, 100.0), **at_10), group("dense", (90.0, 110.0), **at_10)]
    better = group("dense2sparse", (175.0, 177.0), **at_10, name="study-buffer-relabel", buffer="relabel")
    before = {each.claim.id: each.verdict for each in judge([*CLAIMS, *TARGETS], main, {}, STATISTICS)}
    judged = judge_variant([*CLAIMS, *TARGETS], main, [better], "buffer: relabel", STATISTICS)
    after = {each.claim.id: each.verdict for each in judged}
    assert before["target-reach-dense2sparse-oracle-10"] == "not reproduced"
    assert after["target-reach-dense2sparse-oracle-10"] == "reproduced"
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
