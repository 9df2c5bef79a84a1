"""What a simulated robot sees with the camera of its head."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.errors import MissingExtraError, TciError
from tci.lab.pictures.camera import Camera, check_size
from tci.lab.pictures.gl import GlRenderer
from tci.lab.pictures.portrait import Moment, Portrait, keep_moment
from tci.lab.pictures.render import render
from tci.messages import Reading
from tci.messages.frames import Array, read_only
from tci.robot.description import FOV
from tci.simulation.world import World

_log = logging.getLogger("tci")


class HeadCamera:
    """The camera of `<eyes>` in a robot's description, over EGL if it can be had.

    Without PyOpenGL (extra `camera`) or EGL's libraries TCI's own renderer draws, some hundred times slower,
    which it says once. Pictures must be taken by one thread.
    """

    def __init__(self, world: World, *, width: int = 320, height: int = 240, over: str = "") -> None:
        """Prepares pictures of `width` x `height` pixels. `over` demands a renderer, `egl` or `own`. Raises
        TciError for one that can't be had, and for a picture of no pixels."""
        check_size(width, height)
        if over not in ("", "egl", "own"):
            raise TciError(f"pictures over {over!r}; valid: egl, own")
        self._world, self._body = world, GenericBody(world.robot)
        self.portrait = Portrait(world, (), full_scale=1.0)
        """What poses and colours the world's model."""
        self._size = width, height
        self._fov = next((part.eyes.fov for part in world.robot.parts if part.eyes is not None), FOV)
        self._gl: GlRenderer | None = None
        self._slow = ""
        model, colours = self.portrait.model, self.portrait.colours
        if over != "own":
            try:
                self._gl = GlRenderer(model, colours, width=width, height=height)
            except (TciError, MissingExtraError) as error:
                if over:
                    raise
                self._slow = str(error)
        self.over = "own" if self._gl is None else "egl"
        """Renderer that draws: `egl` or `own`."""

    def camera(self, moment: Moment) -> Camera:
        """Where the camera is."""
        T_WT, eyes = self.portrait.torso(moment), self._body.eyes(moment.reading.joints)
        return Camera(read_only(T_WT @ eyes), self._fov, *self._size)

    def picture(
        self, reading: Reading, touching: Mapping[str, Array] = MappingProxyType({})
    ) -> NDArray[np.uint8]:
        """The picture (height, width, 3) of the world now; `reading` tells where the head is, and `touching`
        what touches the robot, if not the world itself (`Recording.touching`)."""
        moment = keep_moment(self._world, reading)
        self._world.show_touching(moment.data, touching)
        data, camera = self.portrait.pose(moment), self.camera(moment)
        if self._gl is not None:
            return self._gl.draw(data, camera)
        begun = time.thread_time()
        drawn = render(self.portrait.model, data, camera, colours=self.portrait.colours)
        if self._slow:
            took, self._slow, why = time.thread_time() - begun, "", self._slow
            _log.warning("a picture takes %.2f s of processor time: %s", took, why)
        return drawn


def head_camera(world: World, *, width: int, height: int) -> Callable[[Reading], NDArray[np.uint8]]:
    """The head's camera of a learning environment. EGL is opened for the first picture: the processes of
    Gymnasium's vector environments are forks, in which an EGL that was open before hangs."""
    check_size(width, height)
    cameras = list[HeadCamera]()

    def picture(reading: Reading) -> NDArray[np.uint8]:
        if not cameras:
            cameras.append(HeadCamera(world, width=width, height=height))
        return cameras[0].picture(reading)

    return picture
