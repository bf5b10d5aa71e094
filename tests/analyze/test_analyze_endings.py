"""How final episodes end: kept, regained, lost, never, fallen."""

from pathlib import Path
from typing import Any

import pytest

from schemas import tables
from schemas.files import write_parquet
from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.endings import MEANINGS
from stages.analyze.results import Row
from stages.analyze.run import run
from stages.analyze.study import ask_all, choose
from tests.analyze.evidence_checks import assert_follows, read_me
from tests.analyze.fake_artifacts import table, write_manifest

TABLE = 0.83  # [m]
EPISODES = {  # steps in which the task is done, of 40; rise of the cube [m]; reward of each step
    "kept": ([*range(20, 40)], 0.2, 2.0),
    "regained": ([*range(10, 20), *range(30, 40)], 0.2, 1.0),
    "lost": ([*range(10, 39)], 0.0, 1.5),
    "never": ([], 0.0, 0.5),
    "fallen": ([*range(10, 30)], -0.8, 0.25),
}


def write_final(root: Path, seed: int, endings: list[str], task: str = "lift") -> None:
    """A run whose final episodes end so; its training episodes are as good as can be."""
    cell = f"{task}-oracle-orbit00-seed{seed}"
    directory = root / "runs" / "main" / cell
    (directory / "transitions").mkdir(parents=True)
    identity = {"task": task, "scheme": "oracle", "misalignment_kind": "orbit", "misalignment_deg": 0.0, "seed": seed}
    steps: list[dict[str, Any]] = []
    for split, number, ending in [("train", 0, "kept"), *(("final", *each) for each in enumerate(endings))]:
        done, rise, reward = EPISODES[ending]
        of_episode = {"run": f"main/{cell}", **identity, "split": split, "episode": number, "reward_dense_true": reward}
        seen = {"observation": [0.0], "action": [0.0]}
        steps += [
            of_episode | seen | {"step": step, "success": step in done, "cube_true_z": TABLE + rise * (step == 39)}
            for step in range(40)
        ]
    write_parquet(table(steps, tables.transitions(1, 1)), directory / "transitions" / "part-00000.parquet")
    write_manifest(directory, f"runs/main/{cell}", {"run": identity}, {})


def answer(root: Path) -> list[Row]:
    return ask_all(root, choose(root, [], []), Silent())["endings"].rows


def ended(row: Row) -> dict[str, tuple[int, float]]:
    """Of the endings that there are: how many, and what they earn on average."""
    return {ending: (row[ending], row[f"{ending}_return"]) for ending in MEANINGS if row[ending]}


def test_every_ending_by_hand(tmp_path: Path) -> None:
    write_final(tmp_path, 0, [*EPISODES])
    (row,) = answer(tmp_path)
    assert row["episodes"] == 5
    assert ended(row) == {
        "kept": (1, 80.0),
        "regained": (1, 40.0),
        "lost": (1, 60.0),
        "never": (1, 20.0),
        "fallen": (1, 10.0),
    }


@pytest.mark.parametrize(
    ("done", "rise", "ending"),
    [
        ([0, *range(3, 40)], 0.0, "kept"),  # 38 of 40 steps
        ([0, *range(4, 40)], 0.0, "regained"),
        ([39], 0.0, "kept"),
        ([*range(40)], -0.04, "kept"),
        ([*range(40)], -0.06, "fallen"),
        ([], -0.06, "fallen"),
    ],
)
def test_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: list[int], rise: float, ending: str) -> None:
    monkeypatch.setitem(EPISODES, "this", (done, rise, 1.0))
    write_final(tmp_path, 0, ["this"], task="reach")
    assert [ended(row) for row in answer(tmp_path)] == [{ending: (1, 40.0)}]


def test_seeds_are_counted_together_and_tasks_are_not(tmp_path: Path) -> None:
    write_final(tmp_path, 0, ["kept", "kept", "kept", "lost"])
    write_final(tmp_path, 1, ["lost", "never"])
    write_final(tmp_path, 0, ["never"], task="reach")
    lift, reach = answer(tmp_path)
    assert (lift["task"], lift["scheme"], lift["episodes"]) == ("lift", "oracle", 6)
    assert ended(lift) == {"kept": (3, 80.0), "lost": (2, 60.0), "never": (1, 20.0)}
    assert (reach["task"], ended(reach)) == ("reach", {"never": (1, 20.0)})


def test_report_and_evidence_say_it(tmp_path: Path) -> None:
    write_final(tmp_path, 0, ["kept", "kept", "kept", "lost"])
    out = tmp_path / "out"
    out.mkdir()
    run(AnalyzeConfig(bootstrap_samples=500), tmp_path, [], [], out, recorder=None, progress=Silent())
    assert_follows(out)
    assert "| lift | 0° | oracle | 4 | 75.0 % (80) | – | 25.0 % (60) | – | – |" in read_me(out)
    page = (out / "report.html").read_text()
    assert '<section id="endings">' in page and '<td class="n">75.0 % (80)</td>' in page
