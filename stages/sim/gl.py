"""OpenGL without a screen: chosen before MuJoCo is imported, checked before work starts."""

import os
import sys
from contextlib import suppress
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


def context_lost(why: object) -> MachineError:
    """The context is of no use any more: frames drawn in it would be those of before, or black."""
    return MachineError(
        f"the OpenGL context was lost ({why}): the driver was reset or the GPU is gone; "
        "what the last checkpoint holds is on disk: once `pipeline doctor` finds OpenGL again, go on with --resume"
    )


def make_current(context: Any) -> None:
    """Have this thread draw in `context`.

    Raises:
        MachineError: it was lost.
    """
    try:
        context.make_current()
    except Exception as error:  # RuntimeError, or EGLError of several lines
        raise context_lost(getattr(getattr(error, "err", None), "name", type(error).__name__)) from error


def free_lost(context: Any) -> None:
    """Let go of a context that was lost."""
    with suppress(Exception):
        context.free()
    context._context = None  # or it frees itself again when it is collected, and complains on stderr


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
