"""Reports of little or odd material: estimators alone, nothing evaluated, markup as names, inputs that changed."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from schemas.errors import ArtifactError, MachineError
from schemas.progress import Silent
from stages.analyze.run import run
from tests.analyze.fake_artifacts import write_estimator, write_manifest
from tests.analyze.fake_runs import write_run
from tests.analyze.report_page import CONFIG, Page, Recordings, analyse, rows


def test_names_are_text_never_markup(tmp_path: Path) -> None:
    name = "<script>alert(1)"
    estimator = write_estimator(tmp_path / "data", '"><img src=x onerror=alert(2)>')
    write_run(tmp_path / "data", name, estimator=estimator)
    analyse(tmp_path / "data", tmp_path / "out", recorder=Recordings())
    page = Page((tmp_path / "out" / "report.html").read_text())
    assert page.tags.count("script") == 3
    assert "img" not in page.tags[: page.tags.index("noscript")]
    assert name in page.text


def test_estimators_alone(tmp_path: Path) -> None:
    write_estimator(tmp_path / "data")
    summary = analyse(tmp_path / "data", tmp_path / "out")
    assert (summary["runs"], summary["results"], summary["recordings"]) == (0, [], [])
    assert "about estimators alone" in (tmp_path / "out" / "report.html").read_text()


def test_the_headline_is_the_worst_of_several_estimators(tmp_path: Path) -> None:
    good = write_estimator(tmp_path / "data", "good")
    write_estimator(tmp_path / "data", "bad")
    write_manifest(good, "estimators/good", {}, {"test_mean_error": 0.011})
    assert analyse(tmp_path / "data", tmp_path / "out")["estimator_error"] == 0.0152
    text = re.sub(r"\s+", " ", Page((tmp_path / "out" / "report.html").read_text()).text)
    assert "Estimator error1.52 cmmean on test episodes, the worst of 2 estimators" in text


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
    class Refusing(Recordings):
        def episode(self, *given: object) -> None:
            raise MachineError("no GL here")

    write_run(tmp_path / "data")
    summary = analyse(tmp_path / "data", tmp_path / "out", recorder=Refusing())
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
        picture = Image.effect_noise((64, 64), 60).convert("RGB")  # many greys, and a small thing with a colour
        picture.paste((90 * number, 20, 160), (20, 20, 26, 26))
        picture.save(figures / f"camera-{title}.png")
    run(CONFIG, tmp_path / "data", [], [], tmp_path / "out", recorder=None, progress=Silent())
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count('src="data:image/png;base64,iVBORw') == 2
    assert html.index("<h4>0°</h4>") < html.index("<h4>orbit 5°</h4>")
    drawn = (figures / "fig3-cameras.svg").read_text()
    assert drawn.count("data:image/jpeg;base64,/9j/") == 2
    pixels = np.asarray(Image.open(figures / "fig3-cameras.png").convert("RGB")).reshape(-1, 3).astype(int)
    for colour in ((0, 20, 160), (90, 20, 160), (255, 255, 255)):
        assert np.abs(pixels - colour).max(axis=1).min() <= 12, f"{colour} is in the picture, but for JPEG's rounding"


def test_unknown_names_and_nothing_to_analyse(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(ArtifactError, match="nothing to analyse"):
        analyse(tmp_path / "data", tmp_path / "a")
    write_run(tmp_path / "data", "here")
    with pytest.raises(ArtifactError, match="no readable artifact 'there' .* valid: here, here/reach"):
        analyse(tmp_path / "data", tmp_path / "b", ["there"])
    with pytest.raises(ArtifactError, match="'eye' .* valid: none there"):
        analyse(tmp_path / "data", tmp_path / "c", [], ["eye"])
