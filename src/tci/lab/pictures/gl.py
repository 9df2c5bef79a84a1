"""MuJoCo's renderer over EGL: no screen is needed, and Mesa computes it where there is no graphics card.

It needs PyOpenGL (extra `camera`) and the libraries of EGL: on Debian `libegl1 libegl-mesa0 libgl1-mesa-dri`.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.lab.pictures.camera import Camera
from tci.messages.frames import Array
from tci.support.engine import mujoco
from tci.support.installed import needs

NEAR, FAR = 0.01, 20.0
"""Distances [m] between which something is drawn."""
MOST = 2000
"""Geoms in a picture, at most."""
NEEDED = "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri"


class GlRenderer:
    """Draws one model. A picture must be drawn by the thread that made the renderer."""

    def __init__(self, model: mujoco.MjModel, colours: Array, *, width: int, height: int) -> None:
        """Opens EGL.

        Args:
            model: What is drawn; the renderer keeps it, with its colours changed.
            colours: Colours (ngeom, 4), 0 to 1, of the geoms. One with an alpha of 0 is not drawn.
            width: Width of the pictures [pixels].
            height: Height [pixels].

        Raises MissingExtraError without PyOpenGL, TciError without EGL.
        """
        with needs("pictures over EGL", "camera"):
            import OpenGL  # noqa: F401
        try:
            from mujoco.egl import GLContext

            self._context = GLContext(width, height)
        except Exception as error:  # EGL's libraries tell what is missing in errors of many types
            raise TciError(f"no pictures over EGL ({error}); valid: {NEEDED}") from error
        self._context.make_current()
        model.geom_matid[:], model.geom_rgba[:] = -1, colours
        model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.4, 0.6
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._model, self._rect = model, mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=MOST)
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._options.geomgroup[:] = 1
        self._drawn = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawn)
        weakref.finalize(self, _free, self._context, self._drawn).atexit = False  # EGL ends before
        self._picture = np.empty((height, width, 3), np.uint8)

    def draw(self, data: mujoco.MjData, camera: Camera) -> NDArray[np.uint8]:
        """The picture (height, width, 3) of the poses in `data`, in which lights are computed too."""
        self._context.make_current()
        mujoco.mj_camlight(self._model, data)
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        side = NEAR * np.tan(camera.fov / 2.0)
        for eye in self._scene.camera:
            eye.pos, eye.up, eye.forward = camera.T_WC[:3, 3], -camera.T_WC[:3, 1], camera.T_WC[:3, 2]
            eye.frustum_near, eye.frustum_far = NEAR, FAR
            eye.frustum_bottom, eye.frustum_top = -side, side
            eye.frustum_center, eye.frustum_width = 0.0, 0.0  # as wide as the picture
        mujoco.mjr_render(self._rect, self._scene, self._drawn)
        mujoco.mjr_readPixels(self._picture, None, self._rect, self._drawn)
        return self._picture[::-1].copy()


def _free(context: Any, drawn: mujoco.MjrContext) -> None:
    context.make_current()  # else another renderer's pictures go
    drawn.free()
    context.free()
