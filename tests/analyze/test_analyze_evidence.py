"""The evidence: it says what the logs say, it is small, and it follows from its own tables."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from pipeline.config import load_config
from schemas.manifest import Origin, read_manifest
from schemas.progress import Silent
from stages.analyze.config import AnalyzeConfig
from stages.analyze.evidence import PARTS
from stages.analyze.run import run
from tests.analyze.evidence_checks import assert_follows, committed
from tests.analyze.fake_runs import write_run
from tests.analyze.fake_study import write_buffer_study, write_paper_study, write_switch_study

COMMITTED = sorted(path.parent for path in (Path(__file__).parents[2] / "results").glob("*/provenance.json"))
LARGEST = 10_000_000  # bytes, of all together
CONFIG = AnalyzeConfig(bootstrap_samples=500)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The paper's matrix, two studies beside it, one failed and one running run."""
    root = tmp_path_factory.mktemp("evidence")
    write_paper_study(root, logged_steps=200)
    estimator = root / "estimators" / "resnet"
    studies = [write_switch_study(root, estimator=estimator), write_buffer_study(root, estimator=estimator)]
    (root / "out").mkdir()
    summary = run(CONFIG, root, [], [], root / "out", studies=studies, recorder=None, progress=Silent())
    return root / "out", summary


def size(directory: Path) -> int:
    paths = [path for part in PARTS for path in [directory / part, *(directory / part).rglob("*")]]
    return sum(path.stat().st_size for path in paths if path.is_file())


def test_evidence_follows_from_its_tables(made: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    """From a copy of the parts alone: neither the logs nor the rest of the report are needed."""
    for part in PARTS:
        (shutil.copytree if (made[0] / part).is_dir() else shutil.copy)(made[0] / part, tmp_path / part)
    assert_follows(tmp_path)
    assert size(tmp_path) < LARGEST / 2


def test_a_changed_answer_changes_what_follows(made: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    for part in PARTS:
        (shutil.copytree if (made[0] / part).is_dir() else shutil.copy)(made[0] / part, tmp_path / part)
    path = tmp_path / "tables" / "outcomes.parquet"
    table = pq.read_table(path)
    changed = [1.0 if i == 0 else value for i, value in enumerate(table["mean_return"].to_pylist())]
    index = table.schema.get_field_index("mean_return")
    pq.write_table(table.set_column(index, "mean_return", [changed]), path)
    with pytest.raises(AssertionError):
        assert_follows(tmp_path)


@pytest.mark.parametrize("directory", COMMITTED, ids=lambda path: path.name)
def test_committed_evidence_follows_from_its_tables(directory: Path) -> None:
    assert_follows(directory)


def test_committed_evidence_is_there_and_small() -> None:
    assert "laptop" in [each.name for each in COMMITTED]
    assert sum(map(size, COMMITTED)) <= LARGEST


def test_no_table_holds_episodes_or_steps(made: tuple[Path, dict[str, Any]]) -> None:
    """Answers grow with runs and settings, not with episodes: 3 seeds logged 15,000 of them."""
    assert all(pq.read_metadata(path).num_rows < 400 for path in (made[0] / "tables").glob("*.parquet"))


def test_readme_names_results_claims_studies_and_what_failed(made: tuple[Path, dict[str, Any]]) -> None:
    text = (made[0] / "README.md").read_text(encoding="utf-8")
    assert "| reach | orbit 10° | dense2sparse (keep, none) |" in text
    assert "| reach | orbit 10° | dense2sparse (relabel, critics), best of study buffer | 191.0 |" in text
    assert "| — with dense2sparse of study buffer: relabel, critics |" in text
    assert "`study/reach-sparse-orbit10-seed3`: failed" in text
    assert "`study/lift-dense2sparse-orbit00-seed3`: running" in text
    assert "of 2 variants 2 evaluated, highest is switch_episode = 150 with 169.0; the main runs (switch_e" in text
    assert "commit 0123456789abcdef" in text
    assert "Imaginary 9000" in text
    for link in ("fig1-estimator", "fig4-reach-curves", "fig5-lift-success", "regions-reach", "study-switch"):
        assert f"](figures/{link}.png)" in text
        assert (made[0] / "figures" / f"{link}.png").is_file()
        assert (made[0] / "figures" / f"{link}.svg").is_file()
    assert not re.search(r"\b(None|nan|inf)\b", text)


def test_study_runs_are_in_the_studies_only(made: tuple[Path, dict[str, Any]]) -> None:
    out, summary = made
    assert summary["runs"] == 50
    assert {row["name"] for row in summary["results"]} == {"study"}
    for name in ("outcomes", "learning-area", "results"):
        assert not any("switch" in str(row.get("run", row["name"])) for row in committed(out, name))
    runs = committed(out, "runs")
    assert [sum(row["main"] is side for row in runs) for side in (True, False)] == [50, 12]
    assert {row["status"] for row in runs} == {"complete", "running", "failed"}


def test_studies_table(made: tuple[Path, dict[str, Any]]) -> None:
    rows = committed(made[0], "studies")
    switch = [row for row in rows if row["study"] == "switch"]
    assert [(row["settings"], row["main"]) for row in switch] == [
        ("policy.switch_episode = 100", True),
        ("policy.switch_episode = 25", False),
        ("policy.switch_episode = 150", False),
    ]
    assert [row["return_mean"] for row in switch[1:]] == [151.0, 169.0]
    assert {row["seeds"] for row in rows} == {3}
    assert [row["also_differs"] for row in switch] == ["", "", ""]  # final_episodes may


def test_what_else_differs_is_said(tmp_path: Path) -> None:
    write_run(tmp_path, outcome=(100.0, 1.0))
    write_run(tmp_path, "study-switch-25", settings={"policy.switch_episode": 25, "world.touch": "hand"})
    study = write_switch_study(tmp_path, seeds=0)
    asked = [type(study)("switch", "When?", study.keys, ("study-switch-25",), "study")]
    (tmp_path / "out").mkdir()
    run(CONFIG, tmp_path, [], [], tmp_path / "out", studies=asked, recorder=None, progress=Silent())
    assert [row["also_differs"] for row in committed(tmp_path / "out", "studies")] == [
        "",
        'world.touch = "hand" (main: "fingers")',
    ]
    text = (tmp_path / "out" / "README.md").read_text()
    assert "on the one seed in common, which says nothing about the spread" in text


def test_configuration_makes_it_again(made: tuple[Path, dict[str, Any]]) -> None:
    file = made[0] / "config.toml"
    config = load_config(file=file)
    assert (
        "# Not the same in all runs, so not here: policy.episodes\n" in file.read_text()
    )  # the failed run's are fewer
    assert config.policy.tasks == ("reach", "lift")
    assert set(config.policy.schemes) == {"oracle", "dense2sparse", "dense", "sparse"}
    assert config.policy.for_task("reach").misalignment_degrees == (0.0, 5.0, 10.0)
    assert config.policy.for_task("lift").misalignment_degrees == (0.0,)
    assert (config.policy.switch_episode, config.world.cube_half_range) == (100, 0.15)
    assert config.analyze == CONFIG
    assert config.studies["switch"].vary == {"policy.switch_episode": [25, 150]}
    assert config.studies["switch"].set["policy.misalignment_degrees"] == [10.0]
    assert config.studies["switch"].set["policy.final_episodes"] == 50
    assert config.studies["buffer"].vary["policy.buffer"] == ["relabel", "empty"]


def test_provenance_names_every_artifact(made: tuple[Path, dict[str, Any]]) -> None:
    told = json.loads((made[0] / "provenance.json").read_text())
    assert len(told["artifacts"]) == 2 + 50 + 12  # dataset, estimator, runs
    assert all(len(artifact["config_sha256"]) == 64 for artifact in told["artifacts"])
    assert len(told["environments"]) == 1
    assert told["analysis"]["bootstrap_samples"] == 500
    assert [study["name"] for study in told["studies"]] == ["switch", "buffer"]


def test_what_began_an_artifact_elsewhere_is_told(tmp_path: Path) -> None:
    directory = write_run(tmp_path, outcome=(100.0, 1.0))
    manifest = read_manifest(directory)
    code = manifest.code.model_copy(update={"git_commit": "f" * 40})
    environment = manifest.environment.model_copy(update={"cpu": "Elsewhere 3000"})
    began = Origin(code=code, environment=environment)
    changed = manifest.model_copy(update={"resumed_from": [began]})
    (directory / "manifest.json").write_text(changed.model_dump_json())
    (tmp_path / "out").mkdir()
    run(CONFIG, tmp_path, [], [], tmp_path / "out", recorder=None, progress=Silent())
    assert_follows(tmp_path / "out")
    text = (tmp_path / "out" / "README.md").read_text()
    for told in ("Elsewhere 3000", "Imaginary 9000", "f" * 40, "0123456789abcdef", "more than one version of the code"):
        assert told in text
