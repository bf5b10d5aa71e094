"""An OpenGL context that is lost under the renderer: an error, never the frame before."""

from typing import Any

import numpy as np
import pytest

import stages.sim  # noqa: F401  # chooses the OpenGL backend before MuJoCo is imported
from schemas.errors import MachineError
from stages.sim import canvas
from stages.sim.camera import nominal_pose
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.renderer import Renderer
from stages.sim.scene import build_scene
from tests.sim.losing_gl import destroy, make_current_nowhere

CAMERA = CameraConfig(image_size=64)


@pytest.fixture
def renderer() -> Renderer:
    return Renderer(build_scene(WorldConfig()), CAMERA.image_size, CAMERA.fovy)


def render(renderer: Renderer) -> np.ndarray:
    return renderer.render(build_scene(WorldConfig()).model.qpos0, nominal_pose(CAMERA))


def test_a_destroyed_context(renderer: Renderer, capfd: pytest.CaptureFixture[str]) -> None:
    render(renderer)
    destroy(renderer._canvas._context)
    with pytest.raises(MachineError, match=r"the OpenGL context was lost \(EGL_BAD_CONTEXT\).*--resume"):
        render(renderer)
    renderer.close()
    del renderer
    assert capfd.readouterr().err == ""


def test_pixels_that_nobody_drew(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a current context MuJoCo draws nothing, reads nothing and says nothing."""
    render(renderer)
    monkeypatch.setattr(canvas, "make_current", make_current_nowhere)
    with pytest.raises(MachineError, match=r"the OpenGL context was lost \(nothing was drawn\)"):
        render(renderer)
    monkeypatch.undo()
    renderer.close()


@pytest.mark.parametrize(("code", "lost"), [(0x0507, True), (0x0505, True), (0x0500, False), (0, False)])
def test_what_the_driver_says(renderer: Renderer, monkeypatch: pytest.MonkeyPatch, code: int, lost: bool) -> None:
    """A driver that was reset says so; a stray invalid enum of MuJoCo's harms nothing."""
    before = render(renderer)
    monkeypatch.setattr(canvas.mujoco, "mjr_getError", lambda: code)
    if lost:
        with pytest.raises(MachineError, match="GL_"):
            render(renderer)
    else:
        assert np.array_equal(render(renderer), before)
    renderer.close()


def test_a_context_that_cannot_be_made_current() -> None:
    from stages.sim.gl import make_current

    class Failing:
        def make_current(self) -> Any:
            raise RuntimeError("Failed to make the EGL context current.")

    with pytest.raises(MachineError, match=r"lost \(RuntimeError\)"):
        make_current(Failing())
