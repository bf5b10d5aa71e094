"""Evidence made in several sittings is the evidence of one."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pipeline.cli import cli
from pipeline.evidence import check_directory, copy_evidence
from schemas.errors import ArtifactError, ConfigError
from schemas.progress import Silent
from stages.analyze.accumulate import accumulate
from stages.analyze.config import AnalyzeConfig
from stages.analyze.run import run
from stages.analyze.studies import Study
from tests.analyze.evidence_checks import assert_follows, committed, read_me
from tests.analyze.fake_artifacts import write_dataset, write_estimator
from tests.analyze.fake_runs import write_run
from tests.analyze.fake_study import write_paper_study, write_switch_study

CONFIG = AnalyzeConfig(bootstrap_samples=200)
GATHERED = " (those of the last sitting: the evidence was gathered in several, by `--accumulate`)"
LATER = ("*-orbit05-*", "*-orbit10-*")  # angles of the second sitting


def report(root: Path, studies: tuple[Study, ...] = ()) -> Path:
    out = root / "out"
    out.mkdir()
    run(CONFIG, root, [], [], out, studies=studies, recorder=None, progress=Silent())
    return out


@pytest.fixture(scope="module")
def sittings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Evidence of everything; of 0° with one variant of a study; of the other angles with the study's other variant."""
    where = tmp_path_factory.mktemp("sittings")
    write_paper_study(where / "all", logged_steps=4000)
    study = write_switch_study(where / "all", estimator=where / "all" / "estimators" / "resnet")
    parts = []
    for name, cells, variant in (("first", LATER, study.runs[:1]), ("second", ("*-orbit00-*",), study.runs[1:])):
        part = where / name
        shutil.copytree(where / "all", part)
        gone = [cell for pattern in cells for cell in (part / "runs" / "study").glob(pattern)]
        gone += [part / "runs" / each for each in study.runs if each not in variant]
        for directory in gone:
            shutil.rmtree(directory)
        parts.append(report(part, (replace(study, runs=variant),)))
    return report(where / "all", (study,)), *parts


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_two_sittings_say_what_one_says(
    sittings: tuple[Path, Path, Path], order: tuple[int, int], tmp_path: Path
) -> None:
    """Also where the main runs beside a study's variant are of the other sitting."""
    once, both = sittings[0], tmp_path / "both"
    accumulate(sittings[order[0]], sittings[order[1]], both)
    assert_follows(both)
    names = {path.stem for path in (once / "tables").glob("*.parquet")}
    assert names == {path.stem for path in (both / "tables").glob("*.parquet")}
    for name in names:
        assert ordered(committed(both, name)) == ordered(committed(once, name)), name
    assert {path.name for path in (both / "figures").iterdir()} == {path.name for path in (once / "figures").iterdir()}
    assert sorted(read_me(both).replace(GATHERED, "").splitlines()) == sorted(read_me(once).splitlines())
    assert GATHERED in read_me(both)
    assert (both / "config.toml").read_text() == (once / "config.toml").read_text()


def ordered(rows: list[dict[str, object]]) -> list[str]:
    return sorted(json.dumps(row, sort_keys=True) for row in rows)


def test_a_part_once_more_changes_nothing(sittings: tuple[Path, Path, Path], tmp_path: Path) -> None:
    once, first, _ = sittings
    accumulate(once, first, tmp_path / "again")
    for path in (once / "tables").glob("*.parquet"):
        assert ordered(committed(tmp_path / "again", path.stem)) == ordered(committed(once, path.stem)), path.stem


def one_run(root: Path, scheme: str = "dense", seed: int = 0, **estimator: Any) -> Path:
    made = write_estimator(root, dataset=write_dataset(root), **estimator)
    write_run(root, scheme=scheme, seed=seed, estimator=made)
    return report(root)


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Evidence of one dense run."""
    return one_run(tmp_path_factory.mktemp("dense") / "root")


def test_a_rerun_replaces_what_was_there(dense: Path, tmp_path: Path) -> None:
    later = tmp_path / "b"
    estimator = write_estimator(later, dataset=write_dataset(later))
    write_run(later, scheme="dense", outcome=(12.5, 0.25), estimator=estimator)
    accumulate(dense, report(later), tmp_path / "both")
    assert [row["mean_return"] for row in committed(tmp_path / "both", "outcomes")] == [12.5]


def test_estimators_made_anew_are_told_apart(dense: Path, tmp_path: Path) -> None:
    """By one configuration another machine makes another estimator."""
    both = tmp_path / "both"
    accumulate(dense, one_run(tmp_path / "b", scheme="sparse", error=0.0171), both)
    assert_follows(both)
    errors = {row["estimator"]: row["test_mean_error"] for row in committed(both, "estimators")}
    assert errors == {"resnet": 0.0152, "resnet (2)": 0.0171}
    assert {row["estimator"] for row in committed(both, "estimator-epochs")} == set(errors)
    used = {row["scheme"]: row["estimator"] for row in committed(both, "runs")}
    assert used == {"dense": "resnet", "sparse": "resnet (2)"}
    assert "one estimator, these runs have 2: resnet in reach at 0° (dense); resnet (2) in reach" in read_me(both)


def test_another_configuration_of_the_same_name_is_refused(dense: Path, tmp_path: Path) -> None:
    other = one_run(tmp_path / "b", scheme="sparse", config={"perception": {"epochs": 29}})
    with pytest.raises(ConfigError, match=r"estimators/resnet was made by another configuration .*--name"):
        accumulate(dense, other, tmp_path / "both")


def test_seeds_of_a_group_are_not_split(dense: Path, tmp_path: Path) -> None:
    later = one_run(tmp_path / "b", seed=1)
    with pytest.raises(ConfigError, match=r"those of now \(study/reach-dense-orbit00-seed0\): the seeds of one group"):
        accumulate(dense, later, tmp_path / "both")


def test_the_configuration_is_what_inputs_of_other_names_share(tmp_path: Path) -> None:
    """Two estimators that differ in one key of [perception]: that key is nobody's."""
    parts = [
        one_run(tmp_path / name, scheme, name=name, config={"perception": {"epochs": epochs, "batch_size": 32}})
        for name, scheme, epochs in (("a", "dense", 8), ("b", "sparse", 9))
    ]
    accumulate(parts[0], parts[1], tmp_path / "both")
    assert tomllib.loads((tmp_path / "both" / "config.toml").read_text())["perception"] == {"batch_size": 32}


def test_a_command_refuses_split_seeds_before_any_work(dense: Path, tmp_path: Path) -> None:
    copy_evidence(dense, tmp_path / "kept")
    asked = ["run", "demo", "--name", "study", "--set", "policy.seeds=[1]", "--data", str(tmp_path / "data")]
    done = CliRunner().invoke(cli, [*asked, "--evidence", str(tmp_path / "kept"), "--accumulate", "--dry-run"])
    assert (done.exit_code, "the seeds of one group" in done.output) == (2, True), done.output


def test_split_seeds_are_refused_before_any_work(dense: Path, tmp_path: Path) -> None:
    copy_evidence(dense, tmp_path / "kept")
    for runs in (
        [],
        ["runs/study/reach-dense-orbit00-seed0", "runs/study/reach-dense-orbit00-seed1"],
        ["runs/x/y-seed1"],
    ):
        check_directory(tmp_path / "kept", tmp_path / "data", True, runs)
    with pytest.raises(ConfigError, match="the seeds of one group"):
        check_directory(tmp_path / "kept", tmp_path / "data", True, ["runs/study/reach-dense-orbit00-seed1"])


def test_evidence_of_an_older_version_is_refused_and_left_alone(dense: Path, tmp_path: Path) -> None:
    old = Path(__file__).parents[2] / "results" / "laptop-studies"
    shutil.copytree(old, tmp_path / "old")
    before = {path: path.read_bytes() for path in (tmp_path / "old").rglob("*") if path.is_file()}
    with pytest.raises(ConfigError, match="another version"):
        copy_evidence(dense, tmp_path / "old", accumulate=True)
    assert before == {path: path.read_bytes() for path in (tmp_path / "old").rglob("*") if path.is_file()}


def test_the_first_sitting_needs_no_earlier_one_and_a_damaged_one_is_named(dense: Path, tmp_path: Path) -> None:
    made, kept = dense, tmp_path / "kept"
    copy_evidence(made, kept, accumulate=True)
    assert (kept / "README.md").read_bytes() == (made / "README.md").read_bytes()
    (kept / "NOTES.md").write_text("by hand")
    copy_evidence(one_run(tmp_path / "b", scheme="sparse"), kept, accumulate=True)
    assert {row["scheme"] for row in committed(kept, "outcomes")} == {"dense", "sparse"}
    assert (kept / "NOTES.md").read_text() == "by hand"
    whole = (kept / "provenance.json").read_text()
    (kept / "provenance.json").write_text(whole[: len(whole) // 2])
    with pytest.raises(ArtifactError, match="cannot be read .*restore it"):
        copy_evidence(made, kept, accumulate=True)
    (kept / "provenance.json").write_text(whole)
    (kept / "tables" / "runs.parquet").write_bytes(b"PAR1")
    with pytest.raises(ArtifactError, match="cannot be read .*restore it"):
        copy_evidence(made, kept, accumulate=True)
    (kept / "config.toml").unlink()
    with pytest.raises(ArtifactError, match=r"no config\.toml"):
        copy_evidence(made, kept, accumulate=True)


def test_what_cannot_be_added_to_is_refused_before_any_work(tmp_path: Path) -> None:
    old = Path(__file__).parents[2] / "results" / "laptop-studies"
    shutil.copytree(old, tmp_path / "old")
    check_directory(tmp_path / "old", tmp_path / "data")
    with pytest.raises(ConfigError, match="another version"):
        check_directory(tmp_path / "old", tmp_path / "data", accumulate=True)
    (tmp_path / "old" / "config.toml").unlink()
    with pytest.raises(ArtifactError, match=r"no config\.toml"):
        check_directory(tmp_path / "old", tmp_path / "data", accumulate=True)


def test_nothing_to_accumulate_in(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--evidence DIR"):
        check_directory(None, tmp_path, accumulate=True)
