"""Reports and pages of comparisons over names and reasons that are markup: they are shown, never run."""

import json
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.run import run as analyse
from stages.analyze.studies import Study
from tests.analyze.fake_runs import write_run
from tests.hostile.cases import cases
from tests.hostile.ground import Ground
from tests.hostile.stock import edit_manifest

MARKUP = (
    *("<script>alert(1)</script>", "</script><script>alert(1)</script>", "javascript:alert(1)", '"onload="alert(1)'),
    *("' onmouseover='alert(1)", "{{7*7}}", "{% raw %}", "<!--", "]]>", "<img src=x onerror=alert(1)>", "&lt;b&gt;"),
    *("</title><h1>", "</style>", "<svg/onload=alert(1)>", "<a href=javascript:alert(1)>x", "\\u003cscript\\u003e"),
    *("<!--<script>", "<base href=//evil>", "<meta http-equiv=refresh content=0>", "`${alert(1)}`"),
)


class Tags(HTMLParser):
    """Elements of a page by their tag, attributes that run something, and links that do."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.counts: Counter[str] = Counter()
        self.live: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.counts[tag] += 1
        self.live += [each for each in attributes if each[0].startswith("on")]
        links = (each for each in attributes if each[0] in ("href", "src", "action", "xlink:href"))
        self.live += [each for each in links if (each[1] or "").strip().lower().startswith("javascript:")]

    def handle_data(self, data: str) -> None:
        self.text += data


def _write(root: Path, name: str, text: str) -> None:
    """Two schemes, one run that failed with `text`, whose every word is `text` where the manifest has room for it."""
    made = [
        write_run(root, name, scheme=scheme, episodes=20, switch=10, logged_steps=200) for scheme in ("dense", "sparse")
    ]
    made.append(write_run(root, name, scheme="oracle", status="failed", final=False, episodes=20, logged_steps=200))
    for directory in made:
        fields = json.loads((directory / "manifest.json").read_bytes())
        config = {**fields["config"], "world": {"robot": text, text: text}, "estimator": text}
        config["policy"] = {**config["policy"], "buffer": text + directory.name}
        machine = {
            **fields["environment"],
            "cpu": text,
            "platform": text,
            "gl_renderer": text,
            "packages": {text: text},
        }
        code = {"version": text, "git_commit": text, "dirty": True}
        words = {"summary": {"error": text, text: text}, "created_at": text}
        edit_manifest(directory, config=config, environment=machine, code=code, **words)


def _report(root: Path, name: str, text: str, out: Path) -> Tags:
    out.mkdir()
    study = Study(text, text, ("policy.buffer",), (name,), name)
    config = AnalyzeConfig(bootstrap_samples=100)
    analyse(config, root, [name], [], out, studies=[study], left_out={text: 1}, recorder=None, progress=Silent())
    return Tags((out / "report.html").read_text())


@pytest.fixture(scope="module")
def benign(tmp_path_factory: pytest.TempPathFactory) -> tuple[Tags, Tags]:
    """The report and the comparison of names that mean nothing."""
    root = tmp_path_factory.mktemp("benign")
    _write(root / "data", "plain", "plain")
    return _report(root / "data", "plain", "plain", root / "report"), _compared(root / "data", "plain", root / "c.html")


def _compared(root: Path, name: str, file: Path) -> Tags:
    from click.testing import CliRunner

    from pipeline.cli import cli

    done = CliRunner().invoke(cli, ["compare", "--save", str(file), "--data", str(root), "--", name])
    assert done.exit_code == 0, done.output
    return Tags(file.read_text())


_texts = st.one_of(st.sampled_from(MARKUP), st.builds("{}{}".format, st.sampled_from(MARKUP), st.sampled_from(MARKUP)))


@cases(1, 25)
@given(_texts)
def test_pages_hold_no_foreign_element(
    ground: Ground, benign: tuple[Tags, Tags], tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    root = tmp_path_factory.mktemp("marked")
    name = text.replace("/", "∕")  # a directory's name holds none; the manifest's words do
    _write(root / "data", name, text)
    with ground.case("pages"):
        pages = _report(root / "data", name, text, root / "report"), _compared(root / "data", name, root / "c.html")
        for page, plain in zip(pages, benign, strict=True):
            assert page.counts == plain.counts
            assert page.live == []
            assert name in page.text  # shown as it is
        assert "49" not in _shown_of("{{7*7}}", pages) if text == "{{7*7}}" else True


def _shown_of(text: str, pages: tuple[Tags, Tags]) -> str:
    return "".join(page.text.partition(text)[1] for page in pages)


def test_a_page_that_is_not_escaped_is_noticed() -> None:
    counts: Any = Tags("<p><script>alert(1)</script></p>").counts
    assert counts == {"p": 1, "script": 1}
    assert Tags('<a href=" JavaScript:x" onclick=y>').live == [("onclick", "y"), ("href", " JavaScript:x")]
