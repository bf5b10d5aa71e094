"""Which episodes are recorded, and where points lead."""

from typing import Any

from stages.analyze.behind import Links, Recording, choose
from stages.analyze.config import AnalyzeConfig


def episode(run: str, reward: float, scheme: str = "dense", main: bool = True, **marks: bool) -> dict[str, Any]:
    return {
        **{"run": run, "name": run.split("/")[0], "task": "reach", "misalignment_kind": "orbit"},
        **{"misalignment_deg": 0.0, "scheme": scheme, "seed": 0, "split": "final", "episode": 7, "main": main},
        **{"return_dense_true": reward, "success": True, "best": False, "worst": False, "typical": True, **marks},
    }


SEEDS = [episode("a/one", 10.0), episode("a/two", 30.0), episode("a/three", 20.0)]
REGION: dict[str, Any] = {
    **{key: SEEDS[0][key] for key in ("name", "task", "misalignment_kind", "misalignment_deg", "scheme")},
    **{"estimation_error": 0.02, "worst_error": 0.05, "worst_run": "a/one", "worst_episode": 3},
}


def test_a_group_is_shown_by_its_median_run() -> None:
    chosen = choose([*SEEDS, episode("a/o", 50.0, "oracle")], [], 9)
    assert [each.run for each in chosen] == ["a/o", "a/three", "a/one", "a/two"]


def test_the_most_asked_for_come_first_and_each_once() -> None:
    extreme = episode("a/two", 30.0, best=True, worst=True)
    chosen = choose(
        [SEEDS[0], extreme, SEEDS[2]], [REGION | {"estimation_error": 0.01, "worst_run": "a/two"}, REGION], 9
    )
    assert [(each.label, each.run, each.episode) for each in chosen] == [
        ("best", "a/two", 7),
        ("typical", "a/three", 7),
        ("worst-estimate", "a/one", 3),
        ("typical", "a/one", 7),
    ]
    assert "on average 5.0 cm off" in chosen[2].note
    assert choose(SEEDS, [REGION], 1) == choose(SEEDS, [REGION], 9)[:1]


def test_of_a_study_each_variant_is_shown_but_not_its_runs() -> None:
    variant = [episode(f"study/{seed}", 10.0 * seed, main=False) for seed in range(3)]
    assert [each.run for each in choose([*variant, SEEDS[0]], [], 9)] == ["a/one", "study/1"]


def test_the_default_reaches_every_group_and_region_of_the_papers_reach() -> None:
    """36 runs: 2 extremes, 12 groups, and 6 of those that learn from estimates."""
    schemes, angles = ("oracle", "dense2sparse", "dense", "sparse"), (0.0, 5.0, 10.0)
    cells = [(scheme, angle, seed) for scheme in schemes for angle in angles for seed in range(3)]
    runs = [episode(f"a/{s}-{a}-{n}", 100.0 + n, s) | {"misalignment_deg": a, "seed": n} for s, a, n in cells]
    runs[0]["best"] = runs[-1]["worst"] = True
    regions = [
        REGION | {"scheme": s, "misalignment_deg": a, "worst_run": None if s == "oracle" else f"a/{s}-{a}-0"}
        for s, a, n in cells
        if n == 0
    ]
    chosen = choose(runs, regions, AnalyzeConfig().recordings)
    labels = [each.label for each in chosen]
    assert [labels.count(label) for label in ("best", "worst", "typical", "worst-estimate")] == [1, 1, 12, 6]
    links = Links([Recording(each.file, each.note, of=each) for each in chosen])
    assert all(links.of_group(run) for run in runs)
    assert all(links.of_region(row) for row in regions if row["scheme"] in ("dense", "dense2sparse"))


def test_where_points_lead() -> None:
    chosen = choose([*SEEDS, episode("a/best", 40.0, "sparse", best=True)], [REGION], 9)
    made = [Recording(each.file, each.note, "no GL" if each.run == "a/two" else None, each) for each in chosen]
    links = Links([*made, Recording("estimator-eye.rrd", "", of="eye"), Recording("comparison.rrd", "")])
    assert links.of_group(SEEDS[0]) == links.of_setting(SEEDS[0]) == "typical-a-three-final-000007.rrd"
    assert links.of_run("a/one") == "typical-a-one-final-000007.rrd"
    assert links.of_run("a/best") == "best-a-best-final-000007.rrd"
    assert links.of_run("a/two") is None  # it could not be recorded
    assert links.of_region(REGION) == "worst-estimate-a-one-final-000003.rrd"
    assert links.of_region(REGION | {"worst_episode": 4}) is None
    assert links.of_group(SEEDS[0] | {"scheme": "oracle"}) is None
    assert (links.of_estimator("eye"), links.of_estimator("other")) == ("estimator-eye.rrd", None)
