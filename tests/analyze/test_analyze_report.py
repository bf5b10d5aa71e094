"""The report: right numbers, whole, self-contained, and honest about what is missing."""

import csv
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader

from schemas.errors import ArtifactError, MachineError
from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.query import run_sql
from stages.analyze.run import run
from tests.analyze.fake_study import write_dataset, write_estimator, write_manifest, write_run

CONFIG = AnalyzeConfig(bootstrap_samples=200)
OUTCOMES = {  # scheme: (episode reward, success rate) of seeds 0 and 1
    "dense2sparse": ((170.0, 1.0), (174.0, 0.98)),
    "dense": ((150.0, 0.9), (160.0, 0.8)),
}


def analyse(root: Path, out: Path, runs: Any = (), estimators: Any = (), record: Any = None) -> dict[str, Any]:
    out.mkdir()
    return run(CONFIG, root, runs, estimators, out, record_episode=record, progress=Silent())


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
    recorded: list[tuple[str, str, int, str]] = []

    def record(run_id: str, split: str, episode: int, path: Path) -> None:
        recorded.append((run_id, split, episode, path.name))
        path.write_bytes(b"rrd")

    summary = analyse(root, root / "report", record=record)
    return root, root / "report", summary | {"recorded": recorded}


class Page(HTMLParser):
    """Elements of a page and what they refer to."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.references: list[tuple[str, str]] = []
        self.tags: list[str] = []
        self.scripts: list[str] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        names = ("src", "href", "srcset", "action", "data-src", "poster", "xlink:href")
        self.references += [(tag, value or "") for name, value in attributes if name in names]
        assert not any(name.startswith("on") for name, _ in attributes)

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] == "script" and self.cdata_elem == "script":
            self.scripts.append(data)
        else:
            self.text += data


def rows(report: Path, table: str) -> list[dict[str, str]]:
    return list(csv.DictReader((report / "tables" / f"{table}.csv").open()))


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
    assert len(questions) == 14
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
    assert "reach, 0°: dense2sparse ends at 172.0, dense at 155.0; their 95 % intervals do not overlap." in text
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


def test_best_and_worst_episodes_are_recorded(study: tuple[Path, Path, dict[str, Any]]) -> None:
    root, report, summary = study
    stream = io.StringIO()
    sql = """SELECT run, episode FROM episodes JOIN runs USING (run) WHERE split = 'final' AND status <> 'failed'
             ORDER BY return_dense_true"""
    run_sql(root, sql, "json", None, stream)
    ordered = [(row["run"], "final", row["episode"]) for row in json.loads(stream.getvalue())]
    assert [entry[:3] for entry in summary["recorded"]] == [ordered[-1], ordered[0]]
    assert summary["recordings"] == ["comparison.rrd", *(entry[3] for entry in summary["recorded"])]
    assert all((report / name).is_file() for name in summary["recordings"])


def test_comparison_recording_holds_curves_and_blueprint(study: tuple[Path, Path, dict[str, Any]]) -> None:
    _, report, _ = study
    reader = RrdReader(str(report / "comparison.rrd"))
    assert [entry.application_id for entry in reader.blueprints()] == ["dense2sparse"]
    chunks = [chunk for chunk in reader.stream() if chunk.entity_path == "/learning_curves/reach_0/dense/mean"]
    assert [chunk.num_rows for chunk in chunks if not chunk.is_static] == [15]  # 300 episodes, one every 20
    assert {name for chunk in chunks for name in chunk.timeline_names} == {"training_episode"}


def test_names_are_text_never_markup(tmp_path: Path) -> None:
    name = "<script>alert(1)"
    estimator = write_estimator(tmp_path / "data", '"><img src=x onerror=alert(2)>')
    write_run(tmp_path / "data", name, estimator=estimator)
    analyse(tmp_path / "data", tmp_path / "out", record=lambda *given: given[3].write_bytes(b""))
    page = Page((tmp_path / "out" / "report.html").read_text())
    assert page.tags.count("script") == 3
    assert "img" not in page.tags[: page.tags.index("noscript")]
    assert name in page.text


def test_estimators_alone(tmp_path: Path) -> None:
    write_estimator(tmp_path / "data")
    summary = analyse(tmp_path / "data", tmp_path / "out")
    assert (summary["runs"], summary["results"], summary["recordings"]) == (0, [], [])
    assert "about estimators alone" in (tmp_path / "out" / "report.html").read_text()


def test_runs_alone_one_seed_and_nothing_evaluated(tmp_path: Path) -> None:
    write_run(tmp_path / "data", "lone", scheme="oracle", logged_steps=0, outcome=(180.0, 1.0))
    summary = analyse(tmp_path / "data", tmp_path / "out")
    assert summary["estimator_error"] is None
    assert summary["results"][0]["return_std"] is None
    young = tmp_path / "young" / "runs" / "a" / "b"
    young.mkdir(parents=True)
    write_manifest(young, "runs/a/b", {}, {}, status="running")
    assert analyse(tmp_path / "young", tmp_path / "out2")["results"][0]["seeds"] == 0
    assert "nothing can be concluded" in (tmp_path / "out2" / "report.html").read_text()


def test_studies_of_several_names_are_kept_apart(tmp_path: Path) -> None:
    for name, reward in (("keep", 100.0), ("relabel", 120.0)):
        write_run(tmp_path / "data", name, outcome=(reward, 0.5))
    summary = analyse(tmp_path / "data", tmp_path / "out", ["keep", "relabel"])
    assert [(row["name"], row["return_mean"]) for row in summary["results"]] == [("keep", 100.0), ("relabel", 120.0)]
    charts = json.loads(Page((tmp_path / "out" / "report.html").read_text()).scripts[0])
    assert len(charts["figures"]["fig4-reach-curves"]) == 2


def test_only_what_was_chosen_is_analysed_with_its_estimator(tmp_path: Path) -> None:
    used, unused = (write_estimator(tmp_path / "data", name) for name in ("used", "unused"))
    write_run(tmp_path / "data", "a", seed=0, estimator=used, outcome=(1.0, 0.1))
    write_run(tmp_path / "data", "a", seed=1, estimator=unused, outcome=(2.0, 0.2))
    summary = analyse(tmp_path / "data", tmp_path / "out", ["a/reach-dense2sparse-orbit00-seed0"])
    assert [(row["seeds"], row["return_mean"]) for row in summary["results"]] == [(1, 1.0)]
    assert {row["estimator"] for row in rows(tmp_path / "out", "estimator-epochs")} == {"used"}


def test_a_recording_that_fails_is_noted_and_the_report_is_there(tmp_path: Path) -> None:
    def refuse(*given: object) -> None:
        raise MachineError("no GL here")

    write_run(tmp_path / "data")
    summary = analyse(tmp_path / "data", tmp_path / "out", record=refuse)
    assert summary["recordings"] == ["comparison.rrd"]
    assert "no GL here" in (tmp_path / "out" / "report.html").read_text()


def test_lineage_shows_an_input_that_changed(tmp_path: Path) -> None:
    estimator = write_estimator(tmp_path / "data", "eye")
    write_run(tmp_path / "data", estimator=estimator)
    write_manifest(estimator, "estimators/eye", {"another": "config"}, {})
    analyse(tmp_path / "data", tmp_path / "out")
    assert "changed since" in (tmp_path / "out" / "report.html").read_text()


def test_camera_pictures_are_shown_when_there(tmp_path: Path) -> None:
    write_run(tmp_path / "data")
    figures = tmp_path / "out" / "figures"
    figures.mkdir(parents=True)
    for number, title in enumerate(("orbit 5°", "0°")):
        Image.new("RGB", (32, 32), (90 * number, 20, 160)).save(figures / f"camera-{title}.png")
    run(CONFIG, tmp_path / "data", [], [], tmp_path / "out", record_episode=None, progress=Silent())
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count('src="data:image/png;base64,iVBORw') == 2
    assert html.index("<h4>0°</h4>") < html.index("<h4>orbit 5°</h4>")
    drawn = (figures / "fig3-cameras.svg").read_text()
    assert drawn.count("data:image/png;base64,iVBORw") == 2
    pixels = np.asarray(Image.open(figures / "fig3-cameras.png").convert("RGB")).reshape(-1, 3)
    assert {(0, 20, 160), (90, 20, 160), (255, 255, 255)} <= set(map(tuple, pixels.tolist()))


def test_unknown_names_and_nothing_to_analyse(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(ArtifactError, match="nothing to analyse"):
        analyse(tmp_path / "data", tmp_path / "a")
    write_run(tmp_path / "data", "here")
    with pytest.raises(ArtifactError, match="no readable artifact 'there' .* valid: here, here/reach"):
        analyse(tmp_path / "data", tmp_path / "b", ["there"])
    with pytest.raises(ArtifactError, match="'eye' .* valid: none there"):
        analyse(tmp_path / "data", tmp_path / "c", [], ["eye"])
