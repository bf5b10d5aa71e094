"""A report made and read."""

import csv
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.run import run


class Recordings:
    """Writes an empty file instead of a recording, and remembers of what."""

    def __init__(self) -> None:
        self.episodes: list[tuple[str, str, int, str]] = []
        self.estimators: list[str] = []

    def episode(self, run: str, split: str, episode: int, file: Path) -> None:
        """Of a logged episode."""
        self.episodes.append((run, split, episode, file.name))
        file.write_bytes(b"rrd")

    def estimator(self, name: str, file: Path) -> None:
        """Of an estimator's frames."""
        self.estimators.append(name)
        file.write_bytes(b"rrd")


CONFIG = AnalyzeConfig(bootstrap_samples=200)


def analyse(root: Path, out: Path, runs: Any = (), estimators: Any = (), recorder: Any = None) -> dict[str, Any]:
    """A report in `out`; returns its summary."""
    out.mkdir()
    return run(CONFIG, root, runs, estimators, out, recorder=recorder, progress=Silent())


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
    """A table of the report as its CSV has it."""
    return list(csv.DictReader((report / "tables" / f"{table}.csv").open()))
