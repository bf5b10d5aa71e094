"""The report: right numbers, whole, self-contained, and honest about what is missing."""

import csv
import io
import json
import re
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from schemas.errors import MachineError
from stages.analyze.curves_recording import write_comparison
from stages.analyze.query import run_sql
from tests.analyze.fake_artifacts import write_dataset, write_estimator, write_manifest
from tests.analyze.fake_runs import write_run
from tests.analyze.report_page import Page, Recordings, analyse, rows

OUTCOMES = {  # scheme: (episode reward, success rate) of seeds 0 and 1
    "dense2sparse": ((170.0, 1.0), (174.0, 0.98)),
    "dense": ((150.0, 0.9), (160.0, 0.8)),
}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, Any]]:
    """Two schemes of two seeds at reach 0°, a failed run, one that has not been evaluated, and a lift run."""
    root = tmp_path_factory.mktemp("study")
    estimator = write_estimator(root, dataset=write_dataset(root))
    for scheme, outcomes in OUTCOMES.items():
        for seed, outcome in enumerate(outcomes):
            write_run(root, "main", "reach", scheme, seed=seed, estimator=estimator, outcome=outcome, final_steps=2)
    write_run(root, "main", "reach", "dense", seed=2, status="failed", final=False, outcome=(1.0, 0.0))
    write_run(root, "main", "lift", "sparse", seed=0, final=False, outcome=(33.0, 0.2))
    young = root / "runs" / "main" / "reach-oracle-orbit00-seed0"
    young.mkdir()
    identity = {"task": "reach", "scheme": "oracle", "misalignment_kind": "orbit", "misalignment_deg": 0.0, "seed": 0}
    write_manifest(young, "runs/main/reach-oracle-orbit00-seed0", {"run": identity}, {}, status="running")
    recordings = Recordings()
    summary = analyse(root, root / "report", recorder=recordings)
    return root, root / "report", summary | {"recorded": recordings.episodes}


def test_summary_holds_the_statistics_of_the_seeds(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, _, summary = study
    assert summary["runs"] == 7
    assert summary["report"] == "report.html"
    assert summary["estimator_error"] == 0.0152
    found = {(row["task"], row["scheme"]): row for row in summary["results"]}
    assert list(found) == [("reach", "oracle"), ("reach", "dense2sparse"), ("reach", "dense"), ("lift", "sparse")]
    assert found["reach", "dense2sparse"]["return_mean"] == 172.0
    assert found["reach", "dense2sparse"]["return_std"] == pytest.approx(8**0.5)
    assert found["reach", "dense2sparse"]["success_mean"] == pytest.approx(0.99)
    assert found["reach", "dense"]["seeds"] == 2  # the failed third one is left out
    assert found["reach", "dense"]["return_mean"] == 155.0
    assert (found["reach", "oracle"]["seeds"], found["reach", "oracle"]["return_mean"]) == (0, None)
    assert found["lift", "sparse"]["return_mean"] == 33.0  # its last evaluation while training: it has no final one


def test_tables_beside_the_report(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    (dense,) = [row for row in rows(report, "results") if row["scheme"] == "dense"]
    assert (dense["seeds"], dense["failed"], dense["judged_by"], dense["episodes"]) == ("2", "1", "final", "1000")
    assert (dense["return_low"], dense["return_high"]) == ("150.0", "160.0")
    paper = {(row["task"], row["misalignment_deg"], row["scheme"]): row for row in rows(report, "paper")}
    assert len(paper) == 14
    ours = paper["reach", "0.0", "dense"]
    assert (ours["paper_return"], ours["return"], ours["seeds"]) == ("165.0", "155.0", "2")
    not_run = paper["reach", "10.0", "sparse"]
    assert (not_run["paper_return"], not_run["return"]) == (
        "55.0",
        "",
    )


def test_every_question_answers_the_same_when_asked_again(study: tuple[Path, Path, dict[str, Any]]) -> None:
    root, report, _ = study
    questions = sorted((report / "tables").glob("*.sql"))
    assert len(questions) == 15
    for question in questions:
        stream = io.StringIO()
        run_sql(root, question.read_text(), "csv", None, stream)
        again = list(csv.reader(io.StringIO(stream.getvalue())))
        if question.stem == "region-correlation":  # no oracle to lose against
            assert (len(again), question.with_suffix(".csv").read_text().strip()) == (1, "")
            continue
        assert len(again) > 1
        for line, expected in zip(again, csv.reader(question.with_suffix(".csv").open()), strict=True):
            assert [_value(cell) for cell in line] == pytest.approx([_value(cell) for cell in expected]), question.name


def _value(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def test_report_loads_nothing_from_elsewhere_and_its_links_lead_somewhere(
    study: tuple[Path, Path, dict[str, Any]],
) -> None:
    _, report, _ = study
    html = (report / "report.html").read_text()
    page = Page(html)
    assert "default-src 'none'" in html
    assert not re.search(r"@import|url\(", html.split("<script")[0])
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)
    ids = set(re.findall(r'id="([^"]+)"', html))
    for _, reference in page.references:
        if reference.startswith("#"):
            assert reference[1:] in ids
        else:
            assert (report / reference).is_file(), reference


def test_report_names_what_is_missing(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    text = re.sub(r"\s+", " ", Page((report / "report.html").read_text()).text)
    assert "main/reach-dense-orbit00-seed2" in text
    assert "1 failed" in text
    assert "1 running" in text
    assert "reach, 0°: dense2sparse ends at 172.0, dense at 155.0, +17.0 (95 % interval +14.0 to +20.0, 2 seeds" in text
    assert "in common), higher (1 failed: the same with failed runs counted as 0)." in text
    assert "With 2 seeds the bootstrap has 3 distinct resamples" in text
    assert "With one seed there is no spread" in text
    assert "1 of 3 groups have runs without a final evaluation" in text


def test_charts_are_data_for_every_panel(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    page = Page((report / "report.html").read_text())
    charts = json.loads(page.scripts[0])
    assert set(charts["themes"]) == {"light", "dark"}
    assert {name: len(panels) for name, panels in charts["figures"].items()} == {
        "fig1-estimator": 1,
        "estimator-misalignment": 1,
        "fig4-reach-curves": 1,
        "fig5-lift-curves": 1,
        "fig4-reach-success": 1,
        "fig5-lift-success": 1,
        "reward-error": 2,
        "regions-reach": 4,  # two schemes by two quantities: without an oracle nothing is known to be lost
    }
    for name in charts["figures"]:
        assert (report / "figures" / f"{name}.svg").read_text().startswith("<svg")
        assert (report / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert "dense2sparse" in (report / "figures" / "fig4-reach-curves.svg").read_text()


def leads(report: Path, figure: str) -> dict[tuple[Any, ...], str]:
    """The rows of a figure that are links, by what tells them apart, and where they lead."""
    panels = json.loads(Page((report / "report.html").read_text()).scripts[0])["figures"][figure]
    linked = [(panel, layer) for panel in panels for layer in panel["layer"] if "href" in layer["encoding"]]
    rows = [row for panel, layer in linked for row in panel["datasets"][layer["data"]["name"]]]
    keys = ("run", "estimator", "scheme", "misalignment_deg", "x", "y")
    return {tuple(row[key] for key in keys if key in row): row["recording"] for row in rows}


def test_every_figure_leads_to_the_episodes_behind_its_points(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, summary = study
    typical = {run: file for run, _, _, file in summary["recorded"] if file.startswith("typical")}
    runs = leads(report, "fig4-reach-success")
    assert {key[0]: file for key, file in runs.items()} == {run: f for run, f in typical.items() if "/reach-" in run}
    curves = leads(report, "fig4-reach-curves")
    assert {key[0] for key in curves} == {"dense2sparse", "dense"}
    assert all(f"main-reach-{key[0]}-orbit00" in file and "typical" in file for key, file in curves.items())
    assert set(leads(report, "estimator-misalignment").values()) == {"estimator-resnet.rrd"}
    assert len(leads(report, "estimator-misalignment")) == 3
    assert set(leads(report, "fig1-estimator").values()) == {"estimator-resnet.rrd"}
    assert curves["dense2sparse", 0.0] in leads(report, "reward-error").values()
    regions = leads(report, "regions-reach")
    assert {key[0] for key in regions} == {"dense2sparse", "dense"}
    for figure in ("fig4-reach-success", "fig4-reach-curves", "regions-reach", "estimator-misalignment"):
        assert ".rrd" not in (report / "figures" / f"{figure}.svg").read_text()
        assert all((report / file).is_file() for file in leads(report, figure).values())


def test_a_region_leads_to_its_own_episode(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    cells = {(row["scheme"], float(row["x"]), float(row["y"])): row for row in rows(report, "regions")}
    for (scheme, _, x, y), file in leads(report, "regions-reach").items():
        row = cells[scheme, x, y]
        run, episode = row["worst_run"].replace("/", "-"), int(row["worst_episode"])
        assert file.endswith(f"-{run}-final-{episode:06d}.rrd")
    assert {scheme for scheme, *_ in leads(report, "regions-reach")} == {"dense2sparse", "dense"}


def _by_run(episodes: list[tuple[str, str, int]]) -> list[tuple[str, list[tuple[str, str, int]]]]:
    return [(run, list(part)) for run, part in groupby(sorted(episodes, key=lambda e: e[0]), lambda e: e[0])]


def test_best_and_worst_episodes_are_recorded_and_the_typical_ones_of_runs(
    study: tuple[Path, Path, dict[str, Any]],
) -> None:
    root, report, summary = study
    stream = io.StringIO()
    sql = """SELECT run, episode FROM episodes JOIN runs USING (run) WHERE split = 'final' AND status <> 'failed'
             ORDER BY return_dense_true"""
    run_sql(root, sql, "json", None, stream)
    ordered = [(row["run"], "final", row["episode"]) for row in json.loads(stream.getvalue())]
    assert {entry[:3] for entry in summary["recorded"][:2]} == {ordered[-1], ordered[0]}
    typical = {(run, "final", of_run[(len(of_run) - 1) // 2][2]) for run, of_run in _by_run(ordered)}
    assert typical < {entry[:3] for entry in summary["recorded"]}
    files = ["comparison.rrd", "estimator-resnet.rrd", *(entry[3] for entry in summary["recorded"])]
    assert summary["recordings"] == files
    assert all((report / name).is_file() for name in files)


def test_runs_of_several_names_share_a_view(tmp_path: Path) -> None:
    row = {"task": "reach", "scheme": "dense", "misalignment_kind": "orbit", "misalignment_deg": 0.0, "std": None}
    curves = [row | {"name": name, "after_episode": 20, "mean": 1.0} for name in ("a", "b")]
    write_comparison(curves, tmp_path / "c.rrd")
    paths = {chunk.entity_path for chunk in RrdReader(str(tmp_path / "c.rrd")).stream()}
    assert {"/learning_curves/reach_0/a_dense/mean", "/learning_curves/reach_0/b_dense/mean"} < paths
    with pytest.raises(MachineError, match="cannot write"):
        write_comparison(curves, tmp_path / "nowhere" / "c.rrd")


def test_comparison_recording_holds_curves_and_blueprint(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    reader = RrdReader(str(report / "comparison.rrd"))
    assert [entry.application_id for entry in reader.blueprints()] == ["dense2sparse"]
    chunks = [chunk for chunk in reader.stream() if chunk.entity_path == "/learning_curves/reach_0/dense/mean"]
    assert [chunk.num_rows for chunk in chunks if not chunk.is_static] == [15]  # 300 episodes, one every 20
    assert {name for chunk in chunks for name in chunk.timeline_names} == {"training_episode"}
