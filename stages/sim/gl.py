"""OpenGL without a screen: chosen before MuJoCo is imported, checked before work starts."""

import os
import sys
from typing import Any

from schemas.errors import MachineError

HELP = "install EGL (`apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri`) or set MUJOCO_GL=osmesa with libosmesa6"


def choose_backend() -> None:
    """Select EGL where the user chose nothing: it needs no display. Must run before `import mujoco`."""
    if sys.platform == "linux":
        # Mesa's software renderer: small frames in many processes; threads of its own would only take their cores.
        os.environ.setdefault("LP_NUM_THREADS", "0")
        os.environ.setdefault("MUJOCO_GL", "egl")
        if os.environ["MUJOCO_GL"] in ("egl", "osmesa"):
            os.environ.setdefault("PYOPENGL_PLATFORM", os.environ["MUJOCO_GL"])


def make_context(size: int) -> Any:
    """An offscreen OpenGL context of size × size pixels, made current.

    Raises:
        MachineError: this machine has no OpenGL that needs no screen.
    """
    try:
        import mujoco

        context = mujoco.GLContext(size, size)
        context.make_current()
    except Exception as error:  # the libraries raise ImportError, AttributeError, RuntimeError, EGLError…
        raise MachineError(f"no OpenGL to render with ({type(error).__name__}: {error}); {HELP}") from error
    return context


def gl_renderer() -> str:
    """Name of the OpenGL renderer, such as `llvmpipe (LLVM 15)` or a GPU.

    Raises:
        MachineError: there is none.
    """
    context = make_context(16)
    try:
        from OpenGL import GL

        return GL.glGetString(GL.GL_RENDERER).decode()
    finally:
        context.free()
