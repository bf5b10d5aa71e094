"""Variants beside the main runs: what differs, which is best, and what may be said of it."""

import json
from typing import Any

import pytest

from stages.analyze.best import best_treatments, sentences
from stages.analyze.config import AnalyzeConfig
from stages.analyze.results import Row
from stages.analyze.statistics import Statistics
from stages.analyze.studies import Study, variants

STATISTICS = Statistics(AnalyzeConfig(bootstrap_samples=500))
STUDY = Study("treatment", "What?", ("policy.buffer",), ("main-t-keep", "main-t-relabel"), "main")


def rows(name: str, buffer: str, returns: tuple[float, ...], degrees: float = 10.0, **policy: Any) -> list[Row]:
    """study-outcomes of the seeds 0, 1, … of one name."""
    config = json.dumps({"policy": {"buffer": buffer, "reset": "none", **policy}, "run": {"seed": 0}})
    common = {"study": "treatment", "main": name == "main", "name": name}
    setting = {"task": "reach", "scheme": "dense2sparse", "misalignment_kind": "orbit", "misalignment_deg": degrees}
    ended = {"status": "complete", "split": "final", "episodes": 50, "success_rate": 1.0}
    missing = {"mean_steps_to_success": None, "mean_estimation_error": None, "config": config}
    return [
        common | setting | ended | missing | {"run": f"{name}/{degrees}-{seed}", "seed": seed, "mean_return": value}
        for seed, value in enumerate(returns)
    ]


MAIN = rows("main", "keep", (100.0, 110.0))


def test_the_best_treatment_is_that_of_the_largest_misalignment() -> None:
    made = [*MAIN, *rows("main", "keep", (170.0, 170.0), degrees=0.0)]
    made += rows("main-t-relabel", "relabel", (120.0, 130.0)) + rows("main-t-relabel", "relabel", (90.0,), degrees=0.0)
    made += rows("main-t-empty", "empty", (60.0, 60.0)) + rows("main-t-empty", "empty", (180.0,), degrees=0.0)
    ((study, best),) = best_treatments(variants(made, [STUDY], STATISTICS), [STUDY])
    assert study is STUDY
    assert [(v.label, v.group.misalignment_deg) for v in best] == [("relabel", 0.0), ("relabel", 10.0)]
    assert best[0].group.treatment == "relabel, none"


def failed(made: list[Row]) -> list[Row]:
    return [row | {"status": "failed", "split": None, "mean_return": None} for row in made]


def test_where_the_main_runs_own_treatment_is_the_best_nothing_is_shown_beside_them() -> None:
    """Their combination is no variant of the study: it is the main runs themselves."""
    made = [*MAIN, *rows("main-t-relabel", "relabel", (60.0, 60.0)), *rows("main-t-empty", "empty", (104.0, 104.0))]
    assert best_treatments(variants(made, [STUDY], STATISTICS), [STUDY]) == []
    better = [*made, *rows("main-t-all", "all", (106.0, 106.0))]
    ((_, best),) = best_treatments(variants(better, [STUDY], STATISTICS), [STUDY])
    assert [v.label for v in best] == ["all"]


def test_a_failed_seed_counts_as_nothing_where_the_best_is_chosen() -> None:
    """190 of one seed is 95 of two."""
    lucky = [*rows("main-t-lucky", "lucky", (190.0,)), *failed(rows("main-t-lucky", "lucky", (0.0, 0.0)))[1:]]
    found = variants([*MAIN, *lucky], [STUDY], STATISTICS)
    assert best_treatments(found, [STUDY]) == []
    (sentence,) = sentences(found, STATISTICS, "95 %")
    assert sentence == (
        "reach, orbit 10°, dense2sparse: of 1 variant 1 evaluated, highest is buffer = lucky with 95.0; the main runs "
        "(buffer = keep) end at 105.0: −10.0 (95 % interval −110.0 to +90.0, 2 seeds in common), not shown to differ. "
        "Failed runs, counted as 0 here: 1 of buffer = lucky."
    )


def test_a_study_of_something_else_has_no_treatments() -> None:
    study = Study("treatment", "What?", ("world.touch",), STUDY.runs, "main")
    made = [*MAIN, *rows("main-t-relabel", "relabel", (120.0,))]
    assert best_treatments(variants(made, [study], STATISTICS), [study]) == []


@pytest.mark.parametrize(
    ("returns", "said"),
    [
        ((120.0, 130.0), "+20.0 (95 % interval +20.0 to +20.0, 2 seeds in common), higher."),
        ((90.0, 130.0), "+5.0 (95 % interval −10.0 to +20.0, 2 seeds in common), not shown to differ."),
        ((80.0, 90.0), "−20.0 (95 % interval −20.0 to −20.0, 2 seeds in common), lower."),
        ((120.0,), "+20.0 on the one seed in common, which says nothing about the spread."),
    ],
)
def test_a_sentence_is_as_strong_as_the_seeds(returns: tuple[float, ...], said: str) -> None:
    found = variants([*MAIN, *rows("main-t-relabel", "relabel", returns)], [STUDY], STATISTICS)
    (sentence,) = sentences(found, STATISTICS, "95 %")
    mean = sum(returns) / len(returns)
    assert sentence == (
        f"reach, orbit 10°, dense2sparse: of 1 variant 1 evaluated, highest is buffer = relabel with {mean:.1f}; "
        f"the main runs (buffer = keep) end at 105.0: {said}"
    )


def test_a_failed_variant_is_there_and_counted() -> None:
    lost = failed(rows("main-t-relabel", "relabel", (0.0,)))
    found = variants([*MAIN, *lost], [STUDY], STATISTICS)
    assert [(v.main, v.group.failed, v.group.returns is None) for v in found] == [(True, 0, False), (False, 1, True)]
    assert sentences(found, STATISTICS, "95 %") == [
        "reach, orbit 10°, dense2sparse: of 1 variant none has been evaluated. "
        "Failed runs, counted as 0 here: 1 of buffer = relabel."
    ]


def test_a_value_may_hold_what_separates_settings() -> None:
    made = rows("main-t-odd", "a = b; policy.c = d", (1.0,))
    (found,) = variants(made, [STUDY], STATISTICS)
    assert found.values == (("policy.buffer", "a = b; policy.c = d"),)
    assert (found.label, found.said) == ("a = b; policy.c = d", "buffer = a = b; policy.c = d")


def test_final_episodes_and_what_is_logged_are_no_difference() -> None:
    made = rows("main", "keep", (1.0,), final_episodes=200, td3={"gamma": 0.9})
    made += rows("main-t-relabel", "relabel", (1.0,), final_episodes=50, checkpoint_every=5, td3={"gamma": 0.97})
    assert [v.also_differs for v in variants(made, [STUDY], STATISTICS)] == [
        "",
        "policy.td3.gamma = 0.97 (main: 0.9)",
    ]
