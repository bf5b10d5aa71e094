"""The rules of the verdicts, on groups whose numbers one can check by hand."""

import pytest

from stages.analyze.claims import Claim
from stages.analyze.formats import deciding
from stages.analyze.paper_claims import CLAIMS
from stages.analyze.verdicts import judge
from tests.analyze.fake_groups import ABOVE, KEEPS, LEVEL, SHARE, SPREAD, STATISTICS, A, group, verdict


@pytest.mark.parametrize(
    ("ours", "theirs", "expected"),
    [
        ((110.0, 121.0, 105.0), (100.0, 111.0, 95.0), "reproduced"),  # +10 for every seed, though the ranges overlap
        ((100.0, 111.0, 95.0), (110.0, 121.0, 105.0), "different"),
        ((110.0, 90.0, 105.0), (100.0, 100.0, 100.0), "not reproduced"),
        ((110.0,), (100.0,), "not reproduced"),  # one seed has no interval
        ((101.2, 102.2, 103.2), (100.0, 101.0, 102.0), "reproduced"),  # +1.2 for every seed
        ((100.8, 101.8, 102.8), (100.0, 101.0, 102.0), "not reproduced"),  # +0.8: less than 1 % of 101.8
        ((4.9004, 4.9005), (4.9, 4.9), "not reproduced"),  # two policies that never touch the cube
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
    ("ours", "expected", "note"),
    [
        ((95.0, 95.0, 95.0), "reproduced", ""),
        ((97.0, 96.0, 99.0), "reproduced", ""),
        ((90.0, 99.0, 99.0), "not reproduced", "not shown"),  # 0.96 on the mean, but 0.90 to 0.99
        ((90.0, 91.0, 94.0), "different", ""),
        ((300.0,), "not reproduced", "one seed has no interval"),
    ],
)
def test_keeping_is_judged_by_the_interval_of_the_ratio(ours: tuple[float, ...], expected: str, note: str) -> None:
    judged = verdict(KEEPS, group("dense2sparse", ours), group("dense", (100.0, 100.0, 100.0)))
    assert (judged.verdict, judged.note) == (expected, note)
    assert judged.effect == pytest.approx(sum(ours) / len(ours) / 100.0)


@pytest.mark.parametrize(
    ("ours", "expected"),
    [((90.0, 99.0, 99.0), "reproduced"), ((94.0, 95.0, 95.0), "not reproduced"), ((95.0,), "reproduced")],
)
def test_a_target_s_share_is_judged_by_the_mean(ours: tuple[float, ...], expected: str) -> None:
    judged = verdict(SHARE, group("dense2sparse", ours), group("dense", (100.0, 100.0, 100.0)))
    assert judged.verdict == expected
    assert deciding(judged).startswith("100.0; × 0.9")


def test_rounding_does_not_miss_a_threshold() -> None:
    """The mean of three rates of 0.95 is 0.9499999999999998, and 0.95 times 1.1 leaves less than 0.95 when divided."""
    target = Claim("id", "success", "target", "at least", "success", A, value=0.95)
    assert verdict(target, group("dense2sparse", (190.0, 190.0, 190.0))).verdict == "reproduced"
    ours, theirs = group("dense2sparse", (0.95 * 1.1,) * 3), group("dense", (1.1,) * 3)
    assert [verdict(claim, ours, theirs).verdict for claim in (KEEPS, SHARE)] == ["reproduced", "reproduced"]
    limit = Claim("id", "error", "§", "at most", "error", None, value=0.3)
    assert judge([limit], [], {"eye": 0.1 + 0.2}, STATISTICS)[0].verdict == "reproduced"


def test_nothing_keeps_of_nothing() -> None:
    ours, theirs = group("dense2sparse", (0.0, 0.0)), group("dense", (0.0, 0.0))
    assert [verdict(claim, ours, theirs).verdict for claim in (KEEPS, SHARE)] == ["not reproduced"] * 2


@pytest.mark.parametrize(
    ("ours", "expected", "note"),
    [
        ((90.0, 90.0), "reproduced", ""),  # 10 % of 100
        ((89.0, 89.0), "different", ""),  # though 11 is less than 10 % of 111
        ((111.0, 111.0), "different", ""),
        ((40.0, 120.0), "not reproduced", "not shown"),  # far off, but 100 is within 40 to 120
        ((85.0,), "different", ""),
    ],
)
def test_a_level_is_judged_by_ten_percent_of_it(ours: tuple[float, ...], expected: str, note: str) -> None:
    judged = verdict(LEVEL, group("dense2sparse", ours))
    assert (judged.verdict, judged.note) == (expected, note)


@pytest.mark.parametrize(
    ("ours", "expected"),
    [
        ((120.0, 80.0, 160.0), "reproduced"),
        ((118.0, 118.0, 118.0), "different"),
        ((118.0, 119.0, 120.0), "not reproduced"),
    ],
)
def test_spread_is_judged_by_its_sign_and_said_not_to_be_shown(ours: tuple[float, ...], expected: str) -> None:
    judged = verdict(SPREAD, group("dense", ours), group("dense2sparse", (198.0, 199.0, 200.0)))
    assert (judged.verdict, judged.note) == (expected, "3 seeds cannot show it")
    if expected == "reproduced":
        assert deciding(judged) == "standard deviations 20.0 pp and 0.5 pp; +19.5 pp"
    alone = verdict(SPREAD, group("dense", ours), group("dense2sparse", (198.0,)))
    assert (alone.verdict, alone.note) == ("not reproduced", "one seed has no spread")


def test_critics_that_catch_up_are_another_treatment() -> None:
    changes = {"buffer": "relabel", "reset": "critics"}
    assert group("dense2sparse", (100.0,), **changes, reset_updates=0).treatment == "relabel, critics"
    caught_up = group("dense2sparse", (100.0,), **changes, reset_updates=4000).treatment
    assert caught_up == "relabel, critics caught up by 4000 updates"


def test_learning_is_measured_by_the_share_of_its_own_final_level() -> None:
    """Both learn equally fast; one gets twice as far."""
    low, high = group("dense", (100.0,)), group("dense2sparse", (200.0,))
    assert (low.scores.area, high.scores.area) == ({0: 0.5}, {0: 0.25})  # an area of 50 each
    assert group("sparse", (100.0,), rate=0.0).scores.area == {}, "what never succeeds has not learnt, at no speed"
    claims = [claim for claim in CLAIMS if claim.quantity == "area"]
    assert {claim.id: "own final level" in claim.statement for claim in claims} == {
        "reach-sparse-slower-dense2sparse": True,
        "reach-sparse-slower-dense": True,
        "reach-dense-converges-like-dense2sparse": True,
    }
