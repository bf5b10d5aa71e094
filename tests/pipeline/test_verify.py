"""`pipeline verify` finds what is not as it was written, and nothing else."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.store import Request, Store
from schemas.errors import ArtifactError
from tests.pipeline.conftest import edit_manifest
from tests.pipeline.fakes import Run, Stages, begin, prepare


@pytest.fixture
def made(run: Run, stages: Stages, store: Store) -> Path:
    """A dataset, an estimator of it and two runs; the dataset's directory."""
    prepare(run, "collect", "train-perception", "train-policy")
    return store.path("datasets/default")


def test_what_is_whole(run: Run, made: Path) -> None:
    found = json.loads(run("verify", "--json").stdout)["artifacts"]
    assert [each["id"].split("/")[0] for each in found] == ["datasets", "estimators", "runs", "runs"]
    assert all(each["problems"] == [] == each["remarks"] and each["files"] > 0 for each in found)
    assert run("verify", "datasets/default").stdout.split()[-1] == "ok"


def _mcap(directory: Path) -> Path:
    return next(iter(sorted(directory.rglob("*.mcap"))))


def _cut(directory: Path) -> None:
    _mcap(directory).write_bytes(_mcap(directory).read_bytes()[:-1])


def _flip(directory: Path) -> None:
    data = bytearray(_mcap(directory).read_bytes())
    data[len(data) // 2] ^= 1
    _mcap(directory).write_bytes(data)


def _remove(directory: Path) -> None:
    _mcap(directory).unlink()


def _link(directory: Path) -> None:
    path = _mcap(directory)
    elsewhere = directory.parents[2] / "elsewhere.mcap"
    path.rename(elsewhere)
    path.symlink_to(elsewhere)


def _add(directory: Path) -> None:
    """What a reader that looks for files would take for its data."""
    (directory / "episodes").mkdir(exist_ok=True)
    (directory / "episodes" / "episode-000999.mcap").write_bytes(_mcap(directory).read_bytes())


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_add, "episode-000999.mcap is in no manifest"),
        (_cut, "bytes instead of"),
        (_flip, "is not what was written"),
        (_remove, "is missing"),
        (_link, "leads out"),
    ],
)
def test_damage_is_found_and_nobody_reads_it(
    run: Run, store: Store, made: Path, damage: Callable[[Path], None], message: str
) -> None:
    damage(made)
    result = run("verify", "--json")
    assert result.exit_code == 3 and "1 of 4 artifacts are damaged, first datasets/default" in result.stderr
    found = json.loads(result.stdout)["error"]["artifacts"]
    assert [len(each["problems"]) for each in found] == [1, 0, 0, 0]
    assert message in found[0]["problems"][0]
    if damage is not _link:
        with pytest.raises(ArtifactError, match="is damaged|which its manifest does not know: remove it"):
            load_complete(store.root, "datasets/default")


def test_a_configuration_that_was_edited(run: Run, made: Path) -> None:
    config = json.loads((made / "manifest.json").read_bytes())["config"]
    assert config["collect"]["episodes"] != 7
    edit_manifest(made, config=config | {"collect": config["collect"] | {"episodes": 7}})
    assert run("verify", "datasets/default").exit_code == 3


def test_two_episodes_that_changed_places(store: Store) -> None:
    with begin(store, Request("datasets/two", {})) as build:
        files = [build.path / name for name in ("a.mcap", "b.mcap")]
        for file, content in zip(files, (b"1111", b"2222"), strict=True):
            file.write_bytes(content)
        build.finish({})
    load_complete(store.root, "datasets/two")
    first, second = (store.path("datasets/two") / file.name for file in files)
    first.write_bytes(b"2222")
    second.write_bytes(b"1111")
    with pytest.raises(ArtifactError, match="is not what was written"):
        load_complete(store.root, "datasets/two")


def test_remarks_are_no_damage(run: Run, made: Path, store: Store, edit: Callable[..., None]) -> None:
    (made / "notes.txt").write_text("mine")
    edit(made, created_at="2020-01-01T00:00:00+00:00")
    found = {each["id"]: each["remarks"] for each in json.loads(run("verify", "--json").stdout)["artifacts"]}
    assert found["datasets/default"] == ["notes.txt is in no manifest"]
    assert found["estimators/default"] == ["its input datasets/default is another one by now"]


def test_a_manifest_that_cannot_be_read(run: Run, made: Path) -> None:
    (made / "manifest.json").write_text("{")
    result = run("verify")
    assert (result.exit_code, "first datasets/default" in result.stderr) == (3, True)


def test_what_is_being_written(run: Run, made: Path, edit: Callable[..., None]) -> None:
    edit(made, status="running", files=[])
    assert "not finished" in run("verify", "datasets/default").stdout


def test_nothing_at_all(run: Run) -> None:
    assert "nothing under" in run("verify").stderr
