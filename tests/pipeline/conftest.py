"""The real commands on a data root of the test's own, over fake stages where a test asks for them."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pipeline.artifacts.store import Build, Request, Store
from pipeline.cli import cli
from tests.pipeline.fakes import Run, Stages
from tests.pipeline.tiny_pipeline import PAIR, pipeline


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Call the command line on an empty data root of the test's own; `input` is what comes on stdin."""

    def call(*arguments: object, input: str | bytes | None = None) -> Result:
        return CliRunner().invoke(cli, [*map(str, arguments), "--data", str(tmp_path / "data")], input=input)

    return call


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """The data root that `run` uses."""
    return tmp_path / "data"


@pytest.fixture
def store(data: Path) -> Store:
    """Artifacts under that root."""
    return Store(data)


def _module(name: str, **members: Any) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(members)
    return module


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> Stages:
    """Put fakes where the commands import the stages from."""
    fake = Stages()
    modules = [
        _module("stages.collect.run", run=fake.collect),
        _module("stages.collect.rerender", make_rerender=lambda dataset: "rerender"),
        _module("stages.perception.training", run=fake.perception),
        _module("stages.policy.train", run=fake.policy),
        _module("stages.policy.resources", Resources=lambda *resources: resources),
        _module("stages.analyze.run", run=fake.analyze),
        _module("pipeline.recordings", Recorder=lambda root: "recorder"),
        _module("pipeline.camera_views", write_camera_views=lambda *given: None),
    ]
    for module in modules:
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr("stages.sim.gl.gl_renderer", fake.gl_renderer)
    return fake


@contextmanager
def _narrow() -> Iterator[None]:
    import torch

    from stages.perception import resnet34

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # other tests of this process may have chosen: an estimator's bits depend on it
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resnet34, "STAGES", ((1, 64), (1, 64), (1, 64), (1, 64)))
        yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def narrow() -> Iterator[None]:
    """An estimator of 0.3 million parameters: how work ends does not depend on its size."""
    with _narrow():
        yield


@pytest.fixture(scope="session")
def never_interrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root in which the real stages, with a narrow estimator, came to their ends; not to be changed."""
    data = tmp_path_factory.mktemp("whole") / "data"
    with _narrow():
        for command in ("collect", "train-perception", "train-policy"):
            done = pipeline(command, data)
            assert done.exit_code == 0, done.output
    return data


@pytest.fixture
def whole(narrow: None, never_interrupted: Path) -> Path:
    """The same, in a module whose estimators are narrow."""
    return never_interrupted


@pytest.fixture(scope="session")
def whole_pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root with two runs that were never interrupted; not to be changed."""
    data = tmp_path_factory.mktemp("pair") / "data"
    done = pipeline("train-policy", data, **PAIR)
    assert done.exit_code == 0, done.output
    return data


@pytest.fixture
def endless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody asks before the work whether there is room."""
    for step in ("collect", "perception", "policy"):
        monkeypatch.setattr(f"pipeline.steps.{step}.require_space", lambda directory, needed: None)


@pytest.fixture
def dataset(store: Store) -> Path:
    """A complete dataset `small` with one Parquet and one MCAP file."""
    begun = store.begin(Request("datasets/small", {"collect": {"episodes": 1}}), resume=False)
    assert isinstance(begun, Build)
    with begun as build:
        (build.path / "frames.parquet").write_bytes(b"parquet")
        (build.path / "episodes").mkdir()
        (build.path / "episodes" / "episode-000000.mcap").write_bytes(b"mcap")
        build.finish({"episodes": 1})
    return store.path("datasets/small")


def edit_manifest(directory: Path, **changes: Any) -> None:
    """Change fields of a manifest on disk, which bears no seal then, as none did once."""
    path = directory / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "seal": None, **changes}))


@pytest.fixture
def edit() -> Callable[..., None]:
    """Changes fields of a manifest on disk."""
    return edit_manifest
