"""The life of an artifact: made, asked for again, interrupted, failed, replaced."""

import errno
import json
import os
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from pipeline.artifacts import space
from pipeline.artifacts import store as store_module
from pipeline.artifacts.inputs import load_complete
from pipeline.artifacts.lock import is_held
from pipeline.artifacts.manifests import differences, file_sha256, read_manifest
from pipeline.artifacts.names import check_name, existing_ids
from pipeline.artifacts.store import Request, Store
from schemas.errors import ArtifactError, ConfigError, MachineError
from schemas.manifest import Code, InputRef, Manifest, config_sha256
from tests.pipeline.conftest import edit_manifest
from tests.pipeline.fakes import begin

ASKED = Request("datasets/small", {"collect": {"episodes": 1}})
OTHER = Request("datasets/small", {"collect": {"episodes": 2}})
REPORT = Request("reports/small", {"analyze": {"seed": 0}})


def interrupt(store: Store, request: Request, error: BaseException) -> None:
    """Write one file, then stop with `error`."""
    with pytest.raises(type(error)), begin(store, request) as build:
        (build.path / "half").write_text("half")
        raise error


@pytest.mark.parametrize("name", ["a", "Demo-2", "a.b_c", "0"])
def test_good_names(name: str) -> None:
    assert check_name(name) == name


@pytest.mark.parametrize("name", ["", ".hidden", "..", "a..b", "a/b", "../a", "a b", "-a", "é", "a\n", "x" * 101])
def test_bad_names(name: str) -> None:
    with pytest.raises(ConfigError, match="cannot be used"):
        check_name(name)


def test_ids_name_a_kind_and_the_right_number_of_names(store: Store) -> None:
    assert store.path("runs/a/b") == store.root / "runs" / "a" / "b"
    for wrong, message in [
        ("runs/a", "runs/NAME/CELL"),
        ("datasets/a/b", "datasets/NAME"),
        ("models/a", "valid: data"),
    ]:
        with pytest.raises(ConfigError, match=message):
            store.path(wrong)


def test_complete_artifact(store: Store, dataset: Path) -> None:
    manifest = load_complete(store.root, "datasets/small")
    assert (manifest.status, manifest.stage, manifest.name) == ("complete", "collect", "small")
    assert [(file.path, file.bytes) for file in manifest.files] == [
        ("episodes/episode-000000.mcap", 4),
        ("frames.parquet", 7),
    ]
    assert manifest.files[1].sha256 == file_sha256(dataset / "frames.parquet")
    assert manifest.summary == {"episodes": 1}
    assert manifest.config_sha256 == config_sha256({"collect": {"episodes": 1}})
    assert manifest.environment.packages["mujoco"] == version("mujoco")


def test_asking_again_is_a_no_op(store: Store, dataset: Path) -> None:
    before = (dataset / "manifest.json").read_bytes()
    again = store.begin(ASKED, resume=False)
    assert isinstance(again, Manifest)
    assert again.status == "complete"
    assert (dataset / "manifest.json").read_bytes() == before


def test_no_op_says_when_a_file_is_gone(store: Store, dataset: Path) -> None:
    (dataset / "frames.parquet").unlink()
    with pytest.raises(ArtifactError, match=r"damaged: .*frames.parquet is missing"):
        store.begin(ASKED, resume=False)


def test_another_config_under_the_same_name(store: Store, dataset: Path) -> None:
    with pytest.raises(ConfigError, match=r"another config \(collect.episodes: 1 → 2\): choose another --name"):
        store.begin(OTHER, resume=True)
    assert read_manifest(dataset, "datasets/small").status == "complete"


def test_a_key_that_an_older_version_did_not_know(store: Store, dataset: Path) -> None:
    """It did what the default says, so asking for the default is asking for the same."""
    defaults = {"collect": {"episodes": 7, "blur": 0.0}}
    same, other = ({"collect": {"episodes": 1, "blur": blur}} for blur in (0.0, 0.5))
    assert isinstance(store.begin(Request(ASKED.id, same, defaults=defaults), resume=False), Manifest)
    with pytest.raises(ConfigError, match=r"another config \(collect.blur: 0.0 → 0.5\)"):
        store.begin(Request(ASKED.id, other, defaults=defaults), resume=True)
    with pytest.raises(ConfigError, match=r"another config \(collect.blur: absent → 0.0\)"):
        store.begin(Request(ASKED.id, same), resume=True)


def test_other_inputs_under_the_same_name(store: Store, dataset: Path) -> None:
    with pytest.raises(ConfigError, match="made from other inputs"):
        store.begin(Request(ASKED.id, ASKED.config, [InputRef(id="runs/a/b", manifest_sha256="0")]), resume=False)


def test_number_of_workers_is_no_difference(store: Store) -> None:
    few, many = ({"collect": {"seed": 0, "workers": workers}} for workers in (1, 8))
    assert config_sha256(few) == config_sha256(many)
    assert differences(few, many) == []
    assert differences(few, {"collect": {"seed": 1}}) == ["collect.seed: 0 → 1"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MachineError("no GPU"), OSError(errno.ENOSPC, "full")])
def test_interrupted_needs_resume(store: Store, error: BaseException) -> None:
    interrupt(store, ASKED, error)
    assert read_manifest(store.path(ASKED.id), ASKED.id).status == "running"
    with pytest.raises(ConfigError, match="interrupted earlier: add --resume"):
        store.begin(ASKED, resume=False)
    with begin(store, ASKED, resume=True) as build:
        assert build.resumed
        assert (build.path / "half").read_text() == "half"
        build.finish({})
    assert load_complete(store.root, ASKED.id).files[0].path == "half"


def test_interrupted_with_another_config_is_not_resumed(store: Store) -> None:
    interrupt(store, ASKED, KeyboardInterrupt())
    with pytest.raises(ConfigError, match="collect.episodes: 1 → 2"):
        store.begin(OTHER, resume=True)


def test_a_refused_resume_changes_nothing(store: Store) -> None:
    interrupt(store, ASKED, KeyboardInterrupt())
    with pytest.raises(MachineError), begin(store, ASKED, resume=True):
        raise MachineError("no GPU")
    assert read_manifest(store.path(ASKED.id), ASKED.id).status == "running"
    assert (store.path(ASKED.id) / "half").read_text() == "half"


def test_what_was_there_empty_is_kept(store: Store) -> None:
    interrupt(store, ASKED, KeyboardInterrupt())
    (store.path(ASKED.id) / "half").unlink()
    with pytest.raises(MachineError), begin(store, ASKED, resume=True):
        raise MachineError("no GPU")
    assert read_manifest(store.path(ASKED.id), ASKED.id).status == "running"


def test_a_reported_failure_is_recorded_and_can_be_resumed(store: Store) -> None:
    with begin(store, ASKED) as build:
        build.fail("NaN at step 7")
    manifest = read_manifest(store.path(ASKED.id), ASKED.id)
    assert (manifest.status, manifest.summary) == ("failed", {"error": "NaN at step 7"})
    with pytest.raises(ConfigError, match=r"failed earlier \(NaN at step 7\): add --resume"):
        store.begin(ASKED, resume=False)
    with begin(store, ASKED, resume=True) as build:
        build.finish({"episodes": 1})
    assert load_complete(store.root, ASKED.id).summary == {"episodes": 1}


def test_nothing_is_left_of_an_artifact_that_never_began(store: Store) -> None:
    with pytest.raises(MachineError), begin(store, ASKED):
        raise MachineError("no GL")
    assert not store.path(ASKED.id).exists()
    assert not is_held(store.root, ASKED.id)


def test_leftover_temporary_files_are_no_part_of_it(store: Store) -> None:
    with begin(store, ASKED) as build:
        (build.path / ".frames.parquet.tmp").write_bytes(b"half")
        (build.path / "frames.parquet").write_bytes(b"whole")
        assert [file.path for file in build.finish({}).files] == ["frames.parquet"]
        assert not (build.path / ".frames.parquet.tmp").exists()


def test_a_full_disk_leaves_the_last_manifest(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left"), begin(store, ASKED) as build:
        (build.path / "half").write_text("half")
        monkeypatch.setattr(os, "fsync", full)
        build.finish({})
    assert read_manifest(store.path(ASKED.id), ASKED.id).status == "running"


def test_space() -> None:
    space.require_space(Path("/"), 1)
    with pytest.raises(MachineError, match="GB free, about 1000000000.0 GB are needed"):
        space.require_space(Path("/not/there/yet"), 10**18)
    assert space.is_disk_full(OSError(errno.ENOSPC, "full"))
    assert space.is_disk_full(RuntimeError("write failed: No space left on device"))
    assert not space.is_disk_full(OSError(errno.EACCES, "denied"))


def test_a_report_is_absent_until_it_is_complete(store: Store) -> None:
    with begin(store, REPORT) as build:
        (build.path / "report.html").write_text("<html>")
        assert not store.path(REPORT.id).exists()
        assert existing_ids(store.root, "reports") == []
        build.finish({})
    assert existing_ids(store.root, "reports") == ["reports/small"]
    assert [path.name for path in (store.root / "reports").iterdir()] == ["small"]


def test_another_device_does_not_go_on(store: Store) -> None:
    """It rounds differently. What is complete answers for both, and an older manifest does not say."""
    gpu = replace(ASKED, device="cuda")
    interrupt(store, ASKED, KeyboardInterrupt())
    path = store.path(ASKED.id)
    before = (path / "manifest.json").read_bytes()
    said = "datasets/small was begun on cpu, and cuda rounds differently: resume it with device=cpu"
    with pytest.raises(ConfigError, match=said):
        store.begin(gpu, resume=True)
    assert (path / "manifest.json").read_bytes() == before
    edit_manifest(path, environment={**json.loads(before)["environment"], "device": None})
    with begin(store, gpu, resume=True) as build:
        assert build.finish({}).environment.device == "cuda"
    assert isinstance(store.begin(ASKED, resume=False), Manifest)


def test_what_began_it_is_remembered(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """By other code, on another machine or renderer; an artifact of older code has none of it."""
    with pytest.raises(KeyboardInterrupt), begin(store, ASKED) as build:
        build.note_renderer("llvmpipe")
        (build.path / "half").write_text("half")
        raise KeyboardInterrupt
    path = store.path(ASKED.id)
    began = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps({key: began[key] for key in began if key != "resumed_from"}))
    with pytest.raises(KeyboardInterrupt), begin(store, ASKED, resume=True) as build:
        build.note_renderer("llvmpipe")
        raise KeyboardInterrupt
    assert read_manifest(path, ASKED.id).resumed_from == [], "it was resumed where it was begun"
    with pytest.raises(KeyboardInterrupt), begin(store, ASKED, resume=True) as build:
        build.note_renderer("another")
        raise KeyboardInterrupt
    monkeypatch.setattr(store_module, "code", lambda: Code(version="9", git_commit=None, dirty=None))
    with begin(store, ASKED, resume=True) as build:
        build.note_renderer("another")
        made = build.finish({})
    assert [(each.code.version, each.environment.gl_renderer) for each in made.resumed_from] == [
        (began["code"]["version"], "llvmpipe"),
        (began["code"]["version"], "another"),
    ]
    assert (made.code.version, made.environment.gl_renderer) == ("9", "another")


def test_an_interrupted_report_leaves_nothing(store: Store) -> None:
    interrupt(store, REPORT, KeyboardInterrupt())
    assert list((store.root / "reports").iterdir()) == []


def test_a_report_that_cannot_be_finished_leaves_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pipeline.artifacts.store.publish", full)
    with pytest.raises(OSError, match="No space left"), begin(store, REPORT) as build:
        build.finish({})
    assert list((store.root / "reports").iterdir()) == []


def test_a_report_whose_inputs_changed_is_replaced_whole(store: Store) -> None:
    for text, inputs in [("old", []), ("new", [InputRef(id="runs/a/b", manifest_sha256="0")])]:
        with begin(store, Request(REPORT.id, REPORT.config, inputs)) as build:
            (build.path / text).write_text(text)
            build.finish({})
    assert sorted(path.name for path in store.path(REPORT.id).iterdir()) == ["manifest.json", "new"]
    assert [path.name for path in (store.root / "reports").iterdir()] == ["small"]


def test_links_where_work_is_done_are_not_followed(store: Store, tmp_path: Path) -> None:
    """One that leads nowhere, and one in the place of what a killed process had begun."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "mine").write_text("kept")
    (store.root / "datasets").mkdir(parents=True, exist_ok=True)
    (store.root / "datasets" / f".{ASKED.id.split('/')[1]}.building-foo").symlink_to(outside)
    with begin(store, ASKED) as build:
        build.finish({})
    assert [path.name for path in outside.iterdir()] == ["mine"]
    other = tmp_path / "other-root"
    other.mkdir()
    (other / ".locks").symlink_to(tmp_path / "nowhere")
    with pytest.raises(ArtifactError, match=r"\.locks is a link that leads out of the data root: remove it"):
        begin(Store(other), ASKED)
