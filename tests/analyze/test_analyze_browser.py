"""The report in a real browser without a network: every chart drawn, light and dark, and nothing wider than a phone."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.run import run
from tests.analyze.fake_artifacts import write_estimator
from tests.analyze.fake_runs import write_run
from tests.analyze.fake_study import write_switch_study
from tests.analyze.report_page import Recordings

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not on PATH")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("browser")
    estimator = write_estimator(root)
    for scheme in ("dense2sparse", "sparse"):
        for degrees in (0.0, 10.0):
            write_run(root, "study", scheme=scheme, degrees=degrees, estimator=estimator, final_steps=2)
    (root / "out").mkdir()
    config = AnalyzeConfig(bootstrap_samples=100)
    studies = [write_switch_study(root, seeds=2)]
    run(config, root, [], [], root / "out", studies=studies, recorder=Recordings(), progress=Silent())
    return root / "out" / "report.html"


def browse(report: Path, profile: Path, *options: str) -> str:
    command = [
        *(str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars"),
        *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
        *("--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}", "--virtual-time-budget=10000"),
        *(*options, report.as_uri()),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


def test_every_chart_is_drawn(report: Path, tmp_path: Path) -> None:
    page = browse(report, tmp_path, "--dump-dom")
    assert page.count('data-chart="') == 2 + 2 + 2 + 1 + 2 * 2 + 1  # regions of dense2sparse, a study
    assert page.count('class="marks"') == page.count('data-chart="')
    assert page.count("cannot be drawn") == 1  # in the script itself


_CLICK_EVERY_MARK = """<script>
let clicked;
HTMLAnchorElement.prototype.dispatchEvent = function () { clicked.dataset.opened += " " + this.getAttribute("href"); };
document.querySelectorAll(".chart").forEach((chart, place) => setTimeout(() => {
  clicked = chart;
  chart.dataset.opened = "";
  for (const mark of chart.querySelectorAll("path")) mark.dispatchEvent(new MouseEvent("click", { bubbles: true }));
}, 3000 + 200 * place));
</script>"""


def test_points_lead_to_recordings(report: Path, tmp_path: Path) -> None:
    clicked = report.with_name("clicked.html")
    clicked.write_text(_CLICK_EVERY_MARK.join(report.read_text().rpartition("</body>")[::2]))
    page = browse(clicked, tmp_path, "--dump-dom")
    opened: dict[str, set[str]] = {}
    for figure, files in re.findall(r'data-chart="([^"]+)"[^>]*data-opened="([^"]*)"', page):
        opened.setdefault(figure, set()).update(files.split())
    assert len(opened) == 7
    for figure, files in opened.items():
        assert files, f"{figure} leads nowhere"
        assert all((report.parent / file).is_file() for file in files)
    assert opened["fig1-estimator"] == opened["estimator-misalignment"] == {"estimator-resnet.rrd"}
    assert all("sparse-orbit10" in file for file in opened["study-switch"])


@pytest.mark.parametrize(("scheme", "page"), [("1", (255, 255, 255)), ("0", (20, 23, 26))])
def test_colours_follow_the_reader_and_series_keep_theirs(
    report: Path, tmp_path: Path, scheme: str, page: tuple[int, int, int]
) -> None:
    picture = tmp_path / "page.png"
    options = (f"--blink-settings=preferredColorScheme={scheme}", "--window-size=500,16000", f"--screenshot={picture}")
    browse(report, tmp_path / "profile", *options)
    pixels = np.asarray(Image.open(picture).convert("RGB"))
    assert tuple(pixels[0, 0]) == page
    for colour in ((0x1A, 0x80, 0xC4), (0x00, 0x9E, 0x73)):  # dense2sparse, sparse
        assert (pixels == colour).all(axis=2).sum() > 200
    assert (pixels[:, -8:] == page).all()  # nothing reaches into the margin of a narrow page
