"""Files that were cut, flipped, blanked, prolonged or swapped: nobody takes them for what was written."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hostile.cases import Damage, cases, damages
from tests.hostile.ground import Ground
from tests.hostile.stock import DATASET, ESTIMATOR, LEARNT, REPLAYED, REPORT

EPISODE = f"{DATASET}/episodes/episode-000000.mcap"
SMALL_LOGS = ("episodes", "evaluations")
READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    DATASET: (("train-perception", "--dataset", "tiny"), ("export", DATASET, "--format", "lerobot", "-o", "out/x")),
    ESTIMATOR: (("train-policy", "--estimator", "resnet", "--name", "n"), ("analyze", "--estimators", "resnet")),
    LEARNT: (
        ("collect", "--policy", LEARNT, "--set", "collect.tasks=['reach']"),
        ("analyze", "--runs", "study"),
        ("relabel", LEARNT, "--scheme", "sparse"),
        ("train-policy", "--offline", LEARNT),
    ),
    REPLAYED: (
        ("export", REPLAYED, "--format", "minari", "-o", "out/x"),
        ("relabel", REPLAYED, "--scheme", "sparse"),
    ),
}
"""Stages and steps that read an artifact: they verify it first."""
ARTIFACTS = (DATASET, ESTIMATOR, LEARNT, REPLAYED, REPORT)


def _files(ground: Ground, artifact: str) -> list[Path]:
    found = (ground.data / artifact).rglob("*")
    return sorted(path for path in found if path.is_file() and path.name != "manifest.json")


@cases(40, 800)
@given(st.data(), st.sampled_from(ARTIFACTS), damages)
def test_no_stage_reads_a_damaged_file(ground: Ground, data: st.DataObject, artifact: str, damage: Damage) -> None:
    path = data.draw(st.sampled_from(_files(ground, artifact)))
    with ground.damaged(path, damage), ground.case("damaged files"):
        assert artifact in ground.refused("verify", artifact).stderr
        for reader in READERS.get(artifact, ()):
            assert "is damaged" in ground.refused(*reader).stderr


@cases(8, 60)
@given(st.data())
def test_files_that_changed_places(ground: Ground, data: st.DataObject) -> None:
    files = [path for artifact in ARTIFACTS for path in _files(ground, artifact)]
    one, other = data.draw(st.lists(st.sampled_from(files), min_size=2, max_size=2, unique=True))
    mine, theirs = one.read_bytes(), other.read_bytes()
    with ground.damaged(one, lambda _: theirs), ground.damaged(other, lambda _: mine), ground.case("swapped files"):
        ground.refused("verify")
        for artifact in (artifact for artifact in ARTIFACTS if str(one).startswith(str(ground.data / artifact))):
            for reader in READERS.get(artifact, ()):
                ground.refused(*reader)


@pytest.fixture(scope="module")
def asked(ground: Ground) -> Ground:
    """A ground that knows the right answers."""
    for question in (*QUESTIONS, *OF_TRANSITIONS, COMPARED, REPLAY, VIEWED, VIEWED_FILE):
        ground.learn(*question)
    return ground


QUESTIONS = tuple(
    ("sql", f"FROM {view} ORDER BY ALL", "--format", "csv")
    for view in ("runs", "episodes", "evaluations", "datasets", "frames", "estimators", "epochs", "predictions")
)
OF_TRANSITIONS = tuple(
    ("sql", question, "--format", "csv")
    for question in (
        "FROM Transitions ORDER BY ALL",
        "WITH late AS (FROM main.transitions WHERE step > 100) SELECT run, avg(reward_used) FROM late GROUP BY run",
        "FROM reward_error_by_distance()",
        f"SELECT sum(distance_true) FROM read_parquet('data/{LEARNT}/transitions/*.parquet')",
        f"SELECT sum(distance_true) FROM 'data/{LEARNT}/transitions/part-00000.parquet'",
        f'SUMMARIZE "data/{LEARNT}/transitions/*.parquet"',
    )
)
COMPARED = ("compare", "study", "--json")
REPLAY = ("replay", REPLAYED, "--episode", "0", "--quiet")
VIEWED = ("view", DATASET, "--save", "out/x.rrd", "--json")
VIEWED_FILE = ("view", f"data/{EPISODE}", "--save", "out/x.rrd", "--json")


@cases(6, 250)
@given(st.data(), damages)
def test_no_answer_is_from_a_damaged_log(asked: Ground, data: st.DataObject, damage: Damage) -> None:
    files = [each for artifact in ARTIFACTS for each in _files(asked, artifact) if each.parent.name != "transitions"]
    with asked.damaged(data.draw(st.sampled_from(files)), damage), asked.case("damaged logs"):
        for question in (data.draw(st.sampled_from(QUESTIONS)), COMPARED):
            asked.not_deceived(*question)


@cases(10, 150)
@given(st.data(), damages)
def test_what_is_shown_is_what_was_logged(asked: Ground, data: st.DataObject, damage: Damage) -> None:
    files = [*_files(asked, REPLAYED), *_files(asked, DATASET)]
    with asked.damaged(data.draw(st.sampled_from(files)), damage), asked.case("damaged episodes"):
        asked.not_deceived(*REPLAY)
        asked.not_deceived(*VIEWED)
        asked.not_deceived(*VIEWED_FILE)


def test_a_file_of_a_dataset_is_verified_as_the_dataset_is(ground: Ground) -> None:
    other = (ground.data / EPISODE).read_bytes().replace(b"dense2sparse", b"dense2sparsE")
    with ground.damaged(ground.data / EPISODE, lambda _: other), ground.case("damaged episodes"):
        said = ground.refused("view", f"data/{EPISODE}", "--save", "out/x.rrd").stderr
        assert f"{DATASET} is damaged: episodes/episode-000000.mcap is not what was written" in said


@cases(8, 150)
@given(st.data(), damages)
def test_no_answer_is_from_damaged_transitions(asked: Ground, data: st.DataObject, damage: Damage) -> None:
    part = asked.data / LEARNT / "transitions" / "part-00000.parquet"
    with asked.damaged(part, damage), asked.case("damaged transitions"):
        asked.not_deceived(*data.draw(st.sampled_from(OF_TRANSITIONS)))


@cases(12, 250)
@given(damages)
def test_an_episode_file_of_nobody(ground: Ground, damage: Damage) -> None:
    whole = (ground.data / EPISODE).read_bytes()
    file = ground.guard / "mine.mcap"
    file.write_bytes(damage(whole))
    with ground.case("MCAP"):
        ground.call("view", file, "--save", "out/x.rrd")
        ground.call("repair", file, "-o", "out/whole.mcap")
    file.unlink()
