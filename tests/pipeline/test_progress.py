"""Bars on a terminal, silence elsewhere."""

from io import StringIO

from rich.console import Console

from pipeline.progress import RichProgress, make_progress
from pipeline.units import duration, figure, size
from schemas.progress import Silent


def test_bars_show_count_and_note_and_can_nest() -> None:
    shown = StringIO()
    progress = RichProgress(Console(file=shown, force_terminal=True, width=120))
    with progress.task("collect", total=4, done=1) as outer:
        outer.advance(2)
        with progress.task("inner", total=10) as inner:
            inner.advance()
        outer.note("loss 0.5")
    text = shown.getvalue()
    assert "collect" in text
    assert "3/4" in text
    assert "loss 0.5" in text
    with progress.task("again", total=1):
        pass
    assert "again" in shown.getvalue()


def test_silent_where_stderr_is_no_terminal() -> None:
    assert isinstance(make_progress(quiet=False), Silent)
    assert isinstance(make_progress(quiet=True), Silent)


def test_figures_for_people() -> None:
    assert [duration(4.12), duration(200), duration(3720)] == ["4.1 s", "3 min 20 s", "1 h 02 min"]
    assert [size(12), size(1_200), size(3_400_000), size(1.25e12)] == ["12 B", "1.2 kB", "3.4 MB", "1250.0 GB"]
    assert [figure(None), figure(0.014159), figure(21_286_211), figure("x")] == ["–", "0.01416", "21,286,211", "x"]
