"""Taking an EGL context away from whoever draws in it."""

from typing import Any

import pytest


def _egl() -> Any:
    mujoco_egl = pytest.importorskip("mujoco.egl", exc_type=Exception)
    if mujoco_egl.EGL_DISPLAY is None:
        pytest.skip("frames are not drawn by EGL here")
    return mujoco_egl


def make_current_nowhere(context: Any) -> None:
    """In the place of making `context` current."""
    egl = _egl()
    none = egl.EGL.EGL_NO_SURFACE
    egl.EGL.eglMakeCurrent(egl.EGL_DISPLAY, none, none, egl.EGL.EGL_NO_CONTEXT)


def destroy(context: Any) -> None:
    """As the driver does when it is reset; a context that is current would live on."""
    egl = _egl()
    make_current_nowhere(context)
    egl.EGL.eglDestroyContext(egl.EGL_DISPLAY, context._context)
