"""Manifests that lie, and such as are no JSON: refused, whoever reads them, and `show` comes to an end."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.hostile.cases import Damage, cases, damages, flip, odd_names
from tests.hostile.ground import Ground
from tests.hostile.stock import DATASET, ESTIMATOR, LEARNT, REPLAYED, REPORT

ARTIFACTS = (DATASET, ESTIMATOR, LEARNT, REPLAYED, REPORT)
STAGES = {
    DATASET: ("train-perception", "--dataset", "tiny"),
    ESTIMATOR: ("train-policy", "--estimator", "resnet", "--name", "n"),
    LEARNT: ("collect", "--policy", LEARNT, "--set", "collect.tasks=['reach']"),
    REPLAYED: ("export", REPLAYED, "--format", "minari", "-o", "out/x"),
    REPORT: ("view", REPORT, "--save", "out/x.rrd"),
}
"""What reads each of them, once it is verified."""
EVERYBODY = (
    *(("list",), ("list", "--json"), ("verify",), ("sql", "FROM runs"), ("sql", "FROM estimators", "--format", "json")),
    *(("compare", "study"), ("analyze", "--dry-run"), ("show", LEARNT, "--json"), ("show", REPORT)),
    *(("replay", REPLAYED, "--episode", "0"), ("view", DATASET, "--save", "out/x.rrd")),
)
Edit = Callable[[dict[str, Any]], Any]


@cases(15, 300)
@given(st.sampled_from(ARTIFACTS), damages, st.data())
def test_bytes(ground: Ground, artifact: str, damage: Damage, data: st.DataObject) -> None:
    with ground.damaged(ground.data / artifact / "manifest.json", damage), ground.case("manifest bytes"):
        ground.call(*STAGES[artifact], "--dry-run" if artifact in (DATASET, ESTIMATOR, LEARNT) else "--quiet")
        ground.call("show", artifact)
        ground.call(*data.draw(st.sampled_from(EVERYBODY)))


@cases(5, 100)
@given(st.sampled_from(ARTIFACTS), st.floats(0, 1, exclude_max=True), st.integers(0, 7))
def test_a_bit_is_seen(ground: Ground, artifact: str, share: float, bit: int) -> None:
    """Wherever it is, but for white space and the word `seal` itself."""
    path = ground.data / artifact / "manifest.json"
    whole = json.loads(path.read_bytes())
    with ground.damaged(path, flip([share], bit)), ground.case("manifest bits"):
        if not _says(path.read_bytes(), whole):
            ground.refused("verify", artifact)
            ground.refused("show", artifact)


def _says(data: bytes, whole: dict[str, Any]) -> bool:
    try:
        return {**json.loads(data), "seal": None} == {**whole, "seal": None}
    except ValueError:
        return False


NO_JSON = (
    *(b"", b"{", b"[]", b"null", b"\xff\xfe", b"\xef\xbb\xbf{}", b"[" * 100_000, b'{"a":' * 5_000, b"\0" * 64),
    *(
        b'{"schema_version": NaN}',
        b'{"schema_version": 1' + b"0" * 5_000 + b"}",
        b'{"schema_version": 1, "id": "\\ud800"}',
    ),
)


@pytest.mark.parametrize("content", NO_JSON, ids=range(len(NO_JSON)))
@pytest.mark.parametrize("artifact", ARTIFACTS)
def test_no_manifests(ground: Ground, artifact: str, content: bytes) -> None:
    with ground.damaged(ground.data / artifact / "manifest.json", lambda _: content), ground.case("no manifests"):
        ground.refused("verify", artifact)
        ground.refused("show", artifact)
        ground.refused(*STAGES[artifact])
        assert "damaged" in ground.call("list").stdout
        if artifact not in (REPORT,):
            ground.refused("sql", "FROM runs")


_odd: st.SearchStrategy[Any] = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), odd_names)
    | st.sampled_from([10**30, -1, 1e308, "x\0y", 10**400, 0.5, "9999-99-99", "2026-01-01T00:00:00+99:99"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(odd_names, inner, max_size=3),
    max_leaves=5,
)
"""Any JSON at all."""
FIELDS = (
    *("id", "stage", "name", "schema_version", "status", "created_at", "config", "config_sha256", "inputs", "code"),
    *("environment", "files", "summary"),
)


@cases(15, 300)
@given(st.sampled_from(ARTIFACTS), st.sampled_from(FIELDS), _odd, st.data())
def test_a_field_that_is_something_else(
    ground: Ground, artifact: str, field: str, value: Any, data: st.DataObject
) -> None:
    with ground.edited(artifact, lambda fields: fields.update({field: value})), ground.case("manifest fields"):
        ground.call(*STAGES[artifact], "--dry-run" if artifact in (DATASET, ESTIMATOR, LEARNT) else "--quiet")
        ground.call("show", artifact, "--json")
        for reader in data.draw(st.lists(st.sampled_from(EVERYBODY), min_size=2, max_size=2)):
            ground.call(*reader)


def _leaves(value: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    if not isinstance(value, dict):
        return [path]
    return [path, *(leaf for key, inner in value.items() for leaf in _leaves(inner, (*path, key)))]


@cases(8, 300)
@given(st.sampled_from(ARTIFACTS), st.sampled_from(["config", "summary", "environment", "code"]), _odd, st.data())
def test_a_setting_that_is_something_else(
    ground: Ground, artifact: str, part: str, value: Any, data: st.DataObject
) -> None:
    whole = json.loads((ground.data / artifact / "manifest.json").read_bytes())
    *sections, last = data.draw(st.sampled_from(_leaves(whole.get(part, {}), (part,))))
    remove = data.draw(st.booleans())

    def edit(fields: dict[str, Any]) -> None:
        for section in sections:
            fields = fields[section]
        fields.pop(last, None) if remove else fields.update({last: value})

    with ground.edited(artifact, edit), ground.case("manifest settings"):
        ground.call(*STAGES[artifact], "--dry-run" if artifact in (DATASET, ESTIMATOR, LEARNT) else "--quiet")
        for reader in data.draw(st.lists(st.sampled_from(EVERYBODY), min_size=3, max_size=3)):
            ground.call(*reader)


_paths = st.one_of(
    odd_names,
    st.sampled_from(["../../outside.txt", "/etc/hostname", "x\0y", "a/" * 3000, "../" * 40 + "etc/hostname", "."]),
    st.builds("{}/../../{}".format, odd_names, odd_names),
)
_sizes = st.sampled_from([0, -1, 10**30, 2**63, "12", None, 1.5, True])


@cases(20, 200)
@given(st.sampled_from(ARTIFACTS[:4]), _paths, st.one_of(st.none(), _sizes))
@example(DATASET, "x\0y", None)  # once an unexpected ValueError: embedded null byte
@example(LEARNT, "x\0y.parquet", None)
@example(ESTIMATOR, "../../outside.txt", None)  # once verified and hashed like a file of its own
def test_a_file_that_is_not_there_or_elsewhere(ground: Ground, artifact: str, path: str, size: Any) -> None:
    def edit(fields: dict[str, Any]) -> None:
        fields["files"].append({"path": path, "bytes": size, "sha256": "0" * 64})

    with ground.edited(artifact, edit), ground.case("manifest files"):
        ground.refused("verify", artifact)
        ground.refused(*STAGES[artifact])
        ground.call("sql", "FROM runs")
        ground.call("show", artifact)


def _foreign(fields: dict[str, Any]) -> None:
    fields["id"], fields["stage"] = DATASET, "collect"


LIES: dict[str, Edit] = {
    "another hash": lambda fields: fields["files"][0].update(sha256="0" * 64),
    "a hash in capitals": lambda fields: fields["files"][0].update(sha256=fields["files"][0]["sha256"].upper()),
    "another size": lambda fields: fields["files"][0].update(bytes=1),
    "two files changed places": lambda fields: fields["files"][0].update(sha256=fields["files"][1]["sha256"]),
    "another's id": _foreign,
    "another stage": lambda fields: fields.update(stage="analyze"),
    "from the future": lambda fields: fields.update(schema_version=10**30),
    "of no version": lambda fields: fields.update(schema_version="1"),
    "half a version": lambda fields: fields.update(schema_version=1.0),
    "a version below the first": lambda fields: fields.update(schema_version=0),
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("artifact", ARTIFACTS[1:4])
def test_lies(ground: Ground, artifact: str, lie: str) -> None:
    with ground.edited(artifact, LIES[lie]), ground.case("manifest lies"):
        ground.refused("verify", artifact)
        ground.refused(*STAGES[artifact])


def test_two_fields_of_one_name(ground: Ground) -> None:
    """JSON does not forbid it, so the last counts for every reader: none is told another story."""

    def twice(data: bytes) -> bytes:
        return data.replace(b'"status"', b'"status": "running", "status"', 1)

    with ground.damaged(ground.data / LEARNT / "manifest.json", twice), ground.case("manifest lies"):
        told = json.loads(ground.call("show", LEARNT, "--json").stdout)["status"]
        assert [row["status"] for row in json.loads(ground.call("list", "runs", "--json").stdout)["artifacts"]][:1] == [
            told
        ]


ROUNDS = [(DATASET, DATASET), (DATASET, ESTIMATOR), (DATASET, LEARNT), (ESTIMATOR, REPORT)]


@pytest.mark.parametrize(("first", "then"), ROUNDS)
def test_inputs_in_a_circle(ground: Ground, first: str, then: str) -> None:
    """Once an unexpected RecursionError."""

    def points_at(other: str) -> Edit:
        return lambda fields: fields.update(inputs=[{"id": other, "manifest_sha256": "0" * 64}] * 3)

    with ground.edited(first, points_at(then)), ground.edited(then, points_at(first)), ground.case("circles"):
        for artifact in (first, then):
            assert ground.call("show", artifact).exit_code == 0
            assert ground.call("show", artifact, "--json").exit_code == 0
            ground.call("verify", artifact)
        ground.call("analyze", "--dry-run")
        ground.call("view", ESTIMATOR, "--save", "out/x.rrd")


@cases(8, 100)
@given(odd_names)
@example("x\0y")
def test_inputs_that_nothing_can_be(ground: Ground, name: str) -> None:
    def edit(fields: dict[str, Any]) -> None:
        fields["inputs"] = [{"id": name, "manifest_sha256": name}, {"id": f"runs/{name}/x", "manifest_sha256": ""}]

    with ground.edited(ESTIMATOR, edit), ground.case("inputs"):
        for reader in (("show", ESTIMATOR), ("verify", ESTIMATOR), STAGES[ESTIMATOR][:-2], ("analyze", "--dry-run")):
            ground.call(*reader, *(("--dry-run",) if reader[0] == "train-policy" else ()))
        ground.call("view", ESTIMATOR, "--save", "out/x.rrd")
