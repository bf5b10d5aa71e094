"""Evidence of little or odd material: what is left out, what the limits are, and how it can be made again."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.config import load_config
from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.run import run
from stages.analyze.studies import Study
from tests.analyze.evidence_checks import assert_follows, committed, read_me
from tests.analyze.fake_artifacts import write_dataset, write_estimator
from tests.analyze.fake_runs import write_run
from tests.analyze.fake_study import write_switch_study

CONFIG = AnalyzeConfig(bootstrap_samples=500)


def analyse(
    root: Path, runs: Sequence[str] = (), studies: Sequence[Study] = (), left_out: Mapping[str, int] = {}
) -> Path:
    out = root / "out"
    out.mkdir()
    run(CONFIG, root, runs, [], out, studies=studies, left_out=left_out, recorder=None, progress=Silent())
    return out


def test_evidence_of_runs_alone(tmp_path: Path) -> None:
    write_run(tmp_path, scheme="oracle", logged_steps=0)
    out = analyse(tmp_path)
    assert_follows(out)
    assert "No run failed and none is unfinished." in read_me(out)


def test_evidence_of_estimators_alone(tmp_path: Path) -> None:
    write_estimator(tmp_path, dataset=write_dataset(tmp_path))
    out = analyse(tmp_path)
    assert_follows(out)
    text = read_me(out)
    assert text.startswith("# The paper's results, measured by us: resnet\n")
    assert "the logs of 1 estimator and no run." in text
    assert "| estimator, mean test error | not reached by the mean | 1 cm | 1.52 cm |" in text
    assert "No run has been evaluated yet: nothing can be concluded" in text
    assert "resnet: 1.5 cm as calibrated; orbit 2." in text
    assert "pipeline run" not in text  # it would train policies


def test_what_is_left_out_is_named_and_redone(tmp_path: Path) -> None:
    write_run(tmp_path, scheme="oracle", logged_steps=0)
    left_out = {"study": 2, "study-switch-25": 3}
    out = analyse(tmp_path, left_out=left_out)
    assert json.loads((out / "provenance.json").read_text())["left_out"] == left_out
    assert_follows(out)
    assert "- `study-switch-25`: 3 unfinished\n" in read_me(out)
    assert "none is unfinished" not in read_me(out)
    assert "<code>study-switch-25</code>: 3 unfinished" in (out / "report.html").read_text()


def test_only_the_selected_main_runs_are_the_reference_of_a_study(tmp_path: Path) -> None:
    """A run of the matrix that is still training, and so not selected, would lower the mean it is compared with."""
    study = write_switch_study(tmp_path, seeds=1)
    write_run(tmp_path, degrees=10.0, seed=0, outcome=(160.0, 1.0))
    write_run(tmp_path, degrees=10.0, seed=1, status="running", final=False, outcome=(3.0, 0.0))
    out = analyse(tmp_path, ["study/reach-dense2sparse-orbit10-seed0"], studies=[study])
    (main,) = [row for row in committed(out, "studies") if row["main"]]
    assert (main["seeds"], main["running"], main["return_mean"]) == (1, 0, 160.0)


def test_limits_count_the_studies_and_what_is_not_the_papers(tmp_path: Path) -> None:
    study = write_switch_study(tmp_path, seeds=1, estimator=write_estimator(tmp_path))
    settings = {"policy.switch_episode": 150}
    write_run(tmp_path, "study-switch-150", degrees=10.0, seed=1, status="failed", final=False, settings=settings)
    write_run(tmp_path, degrees=10.0, estimator=tmp_path / "estimators" / "resnet")
    write_run(tmp_path, task="lift", scheme="oracle")
    out = analyse(tmp_path, studies=[study])
    text = read_me(out)
    assert "- 1 run failed, 1 of them of the studies: left out of the means" in text
    assert "- The smallest evaluation of the studies has 1,000 episodes" in text
    assert "- Robot: Panda (the paper: SCR5)." in text
    assert "within ± 15 cm of the table's centre" in text
    assert "- Training episodes: 300 (the paper does not say how many)." in text
    assert "- Discount: reach 0.9, lift 0.97 (the paper: 0.9)." in text
    assert "- Exploration noise: reach 0.2, lift 0.3 (the paper gives none)." in text
    assert "penalised, with weight 0.1" in text
    assert "- The camera is turned by orbit; the paper does not say how it was." in text
    assert re.search(
        r"resnet: 1\.5 cm as calibrated; orbit \(which the runs have\) 2\.\d cm at 5°, [34]\.\d cm at 10°; pan [56]",
        text,
    )
    assert "[NOTES.md](NOTES.md), where there is one," in text
    html = (out / "report.html").read_text()
    assert "<li>Discount: reach 0.9, lift 0.97 (the paper: 0.9).</li>" in html


def test_several_matrices_have_no_one_command(tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_run(tmp_path, name, scheme="oracle", logged_steps=0)
    out = analyse(tmp_path)
    assert "pipeline run" not in read_me(out)
    assert "No one command makes several matrices (one, other)" in read_me(out)


def test_configuration_keeps_a_study_s_kind_of_misalignment_and_lists_of_seeds(tmp_path: Path) -> None:
    write_run(tmp_path, logged_steps=0)
    for seeds in ((0, 1), (2, 3, 4)):
        for seed in seeds:
            write_run(tmp_path, f"study-many-{'_'.join(map(str, seeds))}", kind="pan", degrees=5.0, seed=seed)
    study = Study("many", "How many?", ("run.seed",), ("study-many-0_1", "study-many-2_3_4"), "study")
    out = analyse(tmp_path, studies=[study])
    made = load_config(file=out / "config.toml").studies["many"]
    assert made.vary == {"policy.seeds": [[0, 1], [2, 3, 4]]}
    assert made.set["policy.misalignment_kind"] == "pan"
    assert made.set["policy.misalignment_degrees"] == [5.0]
