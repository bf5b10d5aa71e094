"""Links: what leads out of the data root, or out of its artifact, is not read; what stays inside is."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.hostile.ground import Ground
from tests.hostile.stock import DATASET, ESTIMATOR, LEARNT, REPLAYED, REPORT

READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    DATASET: (("train-perception", "--dataset", "tiny", "--dry-run"), ("view", DATASET, "--save", "out/x.rrd")),
    ESTIMATOR: (
        ("train-policy", "--estimator", "resnet", "--name", "n", "--dry-run"),
        ("analyze", "--dry-run", "--estimators", "resnet"),
        ("relabel", REPLAYED, "--scheme", "dense", "--estimator", "resnet"),
        ("replay", REPLAYED, "--episode", "0", "--estimator", "resnet", "--save", "out/x.mp4"),
    ),
    LEARNT: (
        ("collect", "--policy", LEARNT, "--set", "collect.tasks=['reach']", "--dry-run"),
        ("analyze", "--dry-run", "--runs", "study"),
        ("train-policy", "--offline", LEARNT, "--dry-run", "--name", "n"),
        ("relabel", LEARNT, "--scheme", "sparse"),
    ),
    REPLAYED: (
        ("replay", REPLAYED, "--episode", "0"),
        ("view", REPLAYED, "--save", "out/x.rrd"),
        ("export", REPLAYED, "--format", "minari", "-o", "out/x"),
    ),
    REPORT: (("view", REPORT, "--save", "out/x.rrd"),),
}
ARTIFACTS = tuple(READERS)
MAKING = {
    DATASET: ("collect", "--name", "tiny", "--resume"),
    ESTIMATOR: ("train-perception", "--name", "resnet", "--dataset", "tiny", "--resume"),
    LEARNT: ("train-policy", "--name", "study", "--set", "policy.schemes=['dense2sparse']", "--estimator", "resnet"),
    REPORT: ("analyze", "--name", "first"),
}


def _whole(path: Path) -> Path:
    return path


def _manifest(path: Path) -> Path:
    return path / "manifest.json"


def _file(path: Path) -> Path:
    return sorted(each for each in path.rglob("*") if each.is_file() and each.name != "manifest.json")[-1]


LINKS: dict[str, Callable[[Path], Path]] = {"the artifact": _whole, "its manifest": _manifest, "a file of it": _file}


@pytest.fixture
def outside(ground: Ground) -> Iterator[Path]:
    made = ground.guard / "elsewhere"
    made.mkdir()
    yield made
    shutil.rmtree(made)


@pytest.fixture
def linked(request: pytest.FixtureRequest) -> Callable[[Path, Path], None]:
    """Move something away and put a link in its place, until the test ends."""

    def link(path: Path, target: Path) -> None:
        path.rename(target)
        path.symlink_to(target)

        def back() -> None:
            path.unlink()
            target.rename(path)

        request.addfinalizer(back)

    return link


@pytest.mark.parametrize("what", LINKS)
@pytest.mark.parametrize("artifact", ARTIFACTS)
def test_out_of_the_data_root(
    ground: Ground, outside: Path, linked: Callable[[Path, Path], None], artifact: str, what: str
) -> None:
    linked(LINKS[what](ground.data / artifact), outside / "moved")
    with ground.case("links out"):
        for reader in READERS[artifact]:
            assert "leads out of" in ground.refused(*reader).stderr
        ground.refused("verify", artifact)
        for reader in (("list",), ("sql", "FROM runs"), ("sql", "FROM transitions"), ("compare", "study")):
            ground.call(*reader)


@pytest.mark.parametrize("artifact", MAKING)
def test_nothing_is_written_through_a_link(
    ground: Ground, outside: Path, linked: Callable[[Path, Path], None], artifact: str
) -> None:
    linked(ground.data / artifact, outside / "moved")
    with ground.case("links out, written"):
        assert "leads out of the data root" in ground.refused(*MAKING[artifact]).stderr


@pytest.mark.parametrize("kind", ["datasets", "estimators", "runs", "reports"])
def test_a_whole_kind_elsewhere(ground: Ground, outside: Path, linked: Callable[[Path, Path], None], kind: str) -> None:
    linked(ground.data / kind, outside / kind)
    artifact = next(each for each in ARTIFACTS if each.startswith(kind))
    with ground.case("links out"):
        assert "leads out of the data root" in ground.refused("verify", artifact).stderr
        for reader in (("list",), ("sql", "FROM runs"), ("sql", "FROM frames"), ("analyze", "--dry-run")):
            ground.call(*reader)


def test_a_planted_log_is_no_log(ground: Ground, request: pytest.FixtureRequest) -> None:
    """Once the views took every part that lay there, listed or not."""
    whole = ground.data / LEARNT / "transitions" / "part-00000.parquet"
    planted = whole.with_name("part-99999.parquet")
    planted.symlink_to(whole)
    request.addfinalizer(planted.unlink)
    with ground.case("planted logs"):
        counted = ground.call(
            "sql", "SELECT run, count(*) FROM transitions GROUP BY ALL ORDER BY ALL", "--format", "csv"
        )
        assert f"{LEARNT.removeprefix('runs/')},200" in counted.stdout


def test_the_data_root_itself_may_be_a_link(ground: Ground, request: pytest.FixtureRequest) -> None:
    link = ground.guard / "link"
    link.symlink_to(ground.data)
    request.addfinalizer(link.unlink)
    with ground.case("links"):
        for artifact in ARTIFACTS:
            assert ground.call("verify", artifact, data=link).exit_code == 0
        for reader in (*READERS[REPLAYED], ("sql", "FROM transitions"), ("compare", "study")):
            assert ground.call(*reader, data=link).exit_code == 0


@pytest.mark.parametrize("artifact", ARTIFACTS)
def test_inside_the_data_root(ground: Ground, linked: Callable[[Path, Path], None], artifact: str) -> None:
    path = ground.data / artifact
    linked(path, path.with_name("moved"))
    with ground.case("links"):
        assert ground.call("verify", artifact).exit_code == 0


@pytest.mark.parametrize("name", ["manifest.json", "episodes.parquet"])
def test_links_in_a_circle(ground: Ground, request: pytest.FixtureRequest, name: str) -> None:
    path = ground.data / LEARNT / name
    moved = path.with_name("moved.away")
    path.rename(moved)
    path.symlink_to(path)
    request.addfinalizer(lambda: moved.replace(path))
    with ground.case("links"):
        for reader in (each for each in READERS[LEARNT] if LEARNT in each):
            ground.refused(*reader)
        for command in (("list",), ("verify",), ("sql", "FROM runs"), ("compare", "study")):
            ground.call(*command)
