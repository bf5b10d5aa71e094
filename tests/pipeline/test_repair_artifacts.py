"""`pipeline repair ARTIFACT`: what is whole stays, what is damaged is said and made again, and the rest of the world
finds the artifact that it knew."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from pipeline.artifacts.manifests import list_files
from pipeline.artifacts.store import Store
from schemas import tables
from schemas.files import write_parquet
from stages.policy import parts
from tests.pipeline.conftest import edit_manifest
from tests.pipeline.fakes import TINY, Run, Stages, answer, prepare, refused
from tests.pipeline.test_full_disk import CELL
from tests.pipeline.test_full_disk import TINY as TRAINING
from tests.pipeline.tiny_pipeline import check_resumed

STEPS = 60


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


class TestDataset:
    @pytest.fixture
    def made(self, run: Run, stages: Stages, store: Store) -> Path:
        prepare(run, "collect", "train-perception")
        return store.path("datasets/default")

    def test_what_is_not_damaged(self, run: Run, made: Path) -> None:
        assert answer(run("repair", "datasets/default", "--json")) == {
            "id": "datasets/default", "is_whole": True, "kept": "2 of 2 files", "lost": [], "then": ""
        }  # fmt: skip

    def test_only_what_is_damaged_is_made_again(self, run: Run, stages: Stages, made: Path) -> None:
        before = (made / "manifest.json").read_bytes()
        flip(made / "episodes/episode-000000.mcap")
        found = answer(run("repair", "datasets/default", "--json"))
        assert (found["kept"], found["lost"]) == (
            "1 of 2 files",
            ["episodes/episode-000000.mcap is not what was written"],
        )
        assert not (made / "episodes/episode-000000.mcap").exists() and (made / "frames.parquet").exists()
        assert answer(run("show", "datasets/default", "--json"))["status"] == "running"
        refused(run("train-perception", "--name", "other", "--dataset", "default"), 3, "is not finished")
        assert answer(run("collect", *TINY, "--resume", "--json"))["did"] == "resumed"
        assert (made / "manifest.json").read_bytes() == before, "it is again what the estimator was made from"
        assert answer(run("train-perception", *TINY, "--json"))["did"] == "nothing"
        assert not [path for path in made.iterdir() if path.name.startswith(".")]

    def test_what_comes_out_otherwise_is_another_one(
        self, run: Run, stages: Stages, made: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        flip(made / "frames.parquet")
        assert run("repair", "datasets/default").exit_code == 0
        original = stages.collect

        def otherwise(*arguments: object, **options: object) -> object:
            summary = original(*arguments, **options)  # type: ignore[arg-type]
            (made / "frames.parquet").write_bytes(b"other frames")
            return summary

        monkeypatch.setattr(sys.modules["stages.collect.run"], "run", otherwise)
        assert run("collect", *TINY, "--resume").exit_code == 0
        assert json.loads(run("show", "estimators/default", "--json").stdout)["lineage"]["inputs"][0]["changed"]

    def test_a_dry_run_touches_nothing(self, run: Run, made: Path) -> None:
        flip(made / "frames.parquet")
        before = {path: path.read_bytes() for path in made.rglob("*") if path.is_file()}
        assert "1 of 2 files kept; dropped: frames.parquet" in run("repair", "datasets/default", "--dry-run").stdout
        assert {path: path.read_bytes() for path in made.rglob("*") if path.is_file()} == before

    def test_a_directory_in_place_of_a_file(self, run: Run, made: Path) -> None:
        (made / "frames.parquet").unlink()
        (made / "frames.parquet" / "deep").mkdir(parents=True)
        assert answer(run("repair", "datasets/default", "--json"))["kept"] == "1 of 2 files"
        assert answer(run("collect", *TINY, "--resume", "--json"))["did"] == "resumed"

    @pytest.mark.parametrize("name", ["manifest.json", ".", "..", "episodes/..", "./manifest.json", "/etc/hostname"])
    def test_a_manifest_that_names_what_is_no_file_of_it(self, run: Run, made: Path, name: str) -> None:
        files = json.loads((made / "manifest.json").read_bytes())["files"]
        edit_manifest(made, files=[*files, {"path": name, "bytes": 1, "sha256": "0" * 64}])
        before = (made / "manifest.json").read_bytes()
        refused(run("repair", "datasets/default"), 3, "is no manifest of this pipeline")
        assert (made / "manifest.json").read_bytes() == before

    def test_a_configuration_that_was_edited_cannot_be_made_whole(self, run: Run, made: Path) -> None:
        config = json.loads((made / "manifest.json").read_bytes())["config"]
        edit_manifest(made, config=config | {"collect": config["collect"] | {"episodes": 7}})
        refused(run("repair", "datasets/default"), 3, "not the one it was made with; restore its manifest")
        refused(run("train-perception", "--name", "other", "--dataset", "default"), 3, "not the one it was made with")

    def test_what_a_link_leads_to_stays(self, run: Run, made: Path, tmp_path: Path) -> None:
        (made / "frames.parquet").rename(tmp_path / "mine.parquet")
        (made / "frames.parquet").symlink_to(tmp_path / "mine.parquet")
        assert "leads out of the artifact" in run("repair", "datasets/default").stdout
        assert (tmp_path / "mine.parquet").exists() and not (made / "frames.parquet").is_symlink()


def test_what_repair_is_not_for(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    assert run("analyze").exit_code == 0
    refused(run("repair", "reports/default"), 2, "`pipeline analyze --name default` makes it again")
    refused(run("repair", "datasets/none"), 3, "does not exist")
    refused(run("repair", "datasets/default", "-o", "x"), 2, "-o is for FILE.mcap")
    refused(run("repair", "x.mcap", "--dry-run"), 2, "--dry-run is for artifacts")


def test_a_dataset_that_was_interrupted(run: Run, whole: Path, data: Path) -> None:
    """Its manifest lists nothing yet: what cannot be read is dropped, and only that is made again."""
    shutil.copytree(whole / "datasets", data / "datasets")
    made, repairing = data / "datasets/n", ("repair", "datasets/n", "--json")
    edit_manifest(made, status="running", files=[])
    (made / "frames.parquet").unlink()
    found = answer(run(*repairing))
    assert (found["kept"], found["is_whole"]) == ("12 of 12 Parquet and MCAP files, not finished", True)
    cut = made / "episodes/episode-000003.mcap"
    cut.write_bytes(cut.read_bytes()[:-1000])
    for options in (["--dry-run"], []):
        assert cut.exists()
        found = answer(run(*repairing, *options))
        assert found["lost"] == ["episodes/episode-000003.mcap cannot be read to its end"]
        assert (found["kept"], found["then"]) == (
            "11 of 12 Parquet and MCAP files, not finished",
            "the command that made it, with --resume, collects what is missing",
        )
    assert len(list(made.glob("episodes/*.mcap"))) == 11 and not cut.exists()
    check_resumed(whole, data, "collect")


def test_a_finished_run(run: Run, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to its last whole episode, which SQL can still be asked about; trained again it is what it was."""
    monkeypatch.setattr(parts, "PART_ROWS", 2 * STEPS)
    settings = [part for key, value in TRAINING.items() for part in ("--set", f"{key}={value}")]
    training = ("train-policy", "--name", "n", *settings, "--set", "policy.episodes=4")
    assert run(*training).exit_code == 0
    logs = ("transitions/part-00000.parquet", "transitions/part-00001.parquet", "transitions/part-00002.parquet")
    kept = (*logs, "evaluations.parquet", "checkpoints/policy.safetensors")
    before = {name: (data / CELL / name).read_bytes() for name in kept}
    flip(data / CELL / logs[1])
    found = answer(run("repair", CELL, "--json"))
    assert found["kept"] == "2 episodes (2 of train)" and "trains it anew, from its first episode" in found["then"]
    assert found["lost"][:3] == [
        f"{logs[1]} is not what was written",
        f"transitions from {logs[1][12:]} on",
        "3 of 5 episodes",
    ]
    asked = run("sql", "select count(*) n, (select count(*) from transitions) t from episodes", "--format", "json")
    assert json.loads(asked.stdout)[0] == {"n": 2, "t": 2 * STEPS}
    assert run(*training, "--resume").exit_code == 0
    assert {name: (data / CELL / name).read_bytes() for name in kept} == before
    assert run("verify").exit_code == 0


@pytest.mark.parametrize("name", ["checkpoints/policy.json", "checkpoints/policy.safetensors", "evaluations.parquet"])
def test_a_run_that_was_killed_when_it_had_ended(run: Run, data: Path, name: str) -> None:
    """Its manifest does not know its files yet: `--resume` looks itself, and `repair` is the way out."""
    settings = [part for key, value in TRAINING.items() for part in ("--set", f"{key}={value}")]
    training = ("train-policy", "--name", "n", *settings, "--set", "policy.episodes=2")
    assert run(*training).exit_code == 0
    edit_manifest(data / CELL, status="running", files=[], summary={})
    assert answer(run("repair", CELL, "--json"))["is_whole"]
    policy = (data / CELL / "checkpoints/policy.safetensors").read_bytes()
    flip(data / CELL / name)
    refused(run(*training, "--resume"), 3, "`pipeline repair`")
    found = answer(run("repair", CELL, "--json"))
    assert not found["is_whole"] and "trains it anew" in found["then"]
    assert run(*training, "--resume").exit_code == 0
    assert (data / CELL / "checkpoints/policy.safetensors").read_bytes() == policy
    assert run("verify").exit_code == 0


def test_a_damaged_recording_is_no_reason_to_train_again(run: Run, stages: Stages, data: Path) -> None:
    prepare(run, "collect", "train-perception", "train-policy")
    directory = data / "runs/default/reach-dense-orbit00-seed0"
    write_parquet(tables.EPISODES.empty_table(), directory / "episodes.parquet")
    write_parquet(tables.EVALUATIONS.empty_table(), directory / "evaluations.parquet")
    write_parquet(tables.UPDATES.empty_table(), directory / "updates.parquet")
    (directory / "recordings").mkdir()
    (directory / "recordings/final-000000.mcap").write_bytes(b"mcap")
    edit_manifest(directory, files=[file.model_dump() for file in list_files(directory)])
    flip(directory / "recordings/final-000000.mcap")
    assert "a replay renders its frames again" in run("repair", "runs/default/reach-dense-orbit00-seed0").stdout
    assert answer(run("show", "runs/default/reach-dense-orbit00-seed0", "--json"))["status"] == "complete"
    assert run("verify").exit_code == 0 and not (directory / "recordings/final-000000.mcap").exists()
