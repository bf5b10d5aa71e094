"""The OpenGL context is really destroyed while a stage renders."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from benchmarks.crash_checks import different
from stages.sim.renderer import Renderer
from tests.pipeline.tiny_pipeline import ARTIFACTS, check_ended, check_kept, check_resumed, pipeline
from tests.sim.losing_gl import destroy


def lose(patch: pytest.MonkeyPatch, frames: int) -> None:
    """After so many frames of this process."""
    drawn, render = [], Renderer.render

    def losing(self: Renderer, *given: Any) -> Any:
        drawn.append(1)
        if len(drawn) == frames:
            destroy(self._canvas._context)
        return render(self, *given)

    patch.setattr(Renderer, "render", losing)


@pytest.mark.parametrize(("command", "frames"), [("collect", 6), ("train-perception", 2)])
@pytest.mark.usefixtures("endless")
def test_it_goes_on_when_there_is_opengl_again(whole: Path, tmp_path: Path, command: str, frames: int) -> None:
    if command != "collect":
        shutil.copytree(whole / "datasets", tmp_path / "datasets")
    with pytest.MonkeyPatch.context() as patch:
        lose(patch, frames)
        check_ended(pipeline(command, tmp_path), "the OpenGL context was lost", "--resume")
    check_kept(tmp_path / ARTIFACTS[command])
    check_resumed(whole, tmp_path, command)


@pytest.mark.usefixtures("endless")
def test_a_policy_that_looks(whole: Path, tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    options = {"policy__schemes": ["dense"], "policy__episodes": 3}
    for data in (one, other):
        shutil.copytree(whole / "estimators", data / "estimators")
    with pytest.MonkeyPatch.context() as patch:
        lose(patch, 40)  # in the third episode, of which every other has a checkpoint
        ended = pipeline("train-policy", one, "--estimator", "n", **options)
    check_ended(ended, "the OpenGL context was lost", "--resume")
    for data, more in ((one, ["--resume"]), (other, [])):
        done = pipeline("train-policy", data, "--estimator", "n", *more, **options)
        assert done.exit_code == 0, done.output
    assert different(one / "runs", other / "runs") == []
