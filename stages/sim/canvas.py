"""An offscreen OpenGL buffer that draws chosen geoms of a model, with or without multisampling."""

from typing import Any

import mujoco
import numpy as np

from schemas.errors import MachineError
from stages.sim.camera import CameraPose
from stages.sim.gl import context_lost, free_lost, make_context, make_current

_SHOWN, _HIDDEN = 1, 5  # geom groups
_LOST = {0x0505: "GL_OUT_OF_MEMORY", 0x0507: "GL_CONTEXT_LOST"}
OPTICAL_TO_GL = np.diag([1.0, -1.0, -1.0])  # OpenGL cameras have y up and look along −z


class Canvas:
    """Owns an OpenGL context, so it belongs to one thread, and modifies `model`, whose camera 0 it takes.

    Raises:
        MachineError: there is no OpenGL that needs no screen.
    """

    def __init__(self, model: Any, size: int, samples: int, fovy: float) -> None:
        self._context = make_context(size)
        self._model, self.data = model, mujoco.MjData(model)
        model.cam_fovy[0] = fovy
        self._scene = mujoco.MjvScene(model, maxgeom=2 * model.ngeom)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = [group == _SHOWN for group in range(len(self._options.geomgroup))]
        self._options.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        self._gl = self._make_gl(size, samples)
        self._most_samples = self._gl.offSamples  # as many of `samples` as OpenGL has

    def place(self, qpos: np.ndarray, pose: CameraPose) -> None:
        """Make this the thread's current canvas, its geoms at generalised positions `qpos` (nq,), seen from `pose`."""
        make_current(self._context)  # another canvas of this thread may have drawn since
        data = self.data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        data.cam_xpos[0] = pose.position
        data.cam_xmat[0] = (pose.rotation @ OPTICAL_TO_GL).ravel()

    def select(self, geoms: np.ndarray, sky: bool) -> None:
        """Choose what `draw` draws: the geoms of this mask (ngeom,), and the sky behind them."""
        self._model.geom_group[:] = np.where(geoms, _SHOWN, _HIDDEN)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = sky
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self.data, self._options, None, self._camera, everything, self._scene)

    def resize(self, size: int, multisampled: bool) -> None:
        """Draw size × size pixels from now on. A second context would cost 140 MB for its copy of the textures."""
        self._gl.offSamples = self._most_samples if multisampled else 0
        mujoco.mjr_resizeOffscreen(size, size, self._gl)

    def draw(self, image: np.ndarray, depth: np.ndarray | None) -> None:
        """Draw into `image` (H, W, 3) uint8, bottom row first; and `depth` (H, W) float32: 1 is nearest, 0 the sky.

        Raises:
            MachineError: the OpenGL context was lost.
        """
        viewport = mujoco.MjrRect(0, 0, image.shape[1], image.shape[0])
        if depth is not None:
            depth[0, 0] = np.nan
        mujoco.mjr_render(viewport, self._scene, self._gl)
        mujoco.mjr_readPixels(image, depth, viewport, self._gl)
        self._check(depth)

    def _check(self, depth: np.ndarray | None) -> None:
        """A lost context draws nothing and says nothing: the pixels stay as they were, unless it is asked."""
        error = mujoco.mjr_getError()
        if error in _LOST:
            raise context_lost(_LOST[error])
        if depth is not None and np.isnan(depth[0, 0]):
            raise context_lost("nothing was drawn")

    def close(self) -> None:
        """Free the OpenGL context."""
        try:
            make_current(self._context)  # else another canvas's textures and buffers of the same numbers would be freed
        except MachineError:
            free_lost(self._context)
            return
        self._gl.free()
        self._context.free()

    def _make_gl(self, size: int, samples: int) -> Any:
        view = self._model.vis
        view.global_.offwidth = view.global_.offheight = size
        view.quality.offsamples = samples
        view.quality.shadowsize = 0  # no light of robosuite's arenas casts a shadow
        gl = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        gl.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # as precise at the horizon as the buffer itself
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        return gl
