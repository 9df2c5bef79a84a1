"""The camera in a simulated robot's head, for environments and recordings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.messages import Reading
from tci.simulation.world import World
from tci.support.installed import needs

with needs("the environments of tci.learn", "gym"):
    from gymnasium.envs.registration import load_env_creator

CAMERA = "tci.lab.pictures.head_camera:head_camera"
"""Named as Gymnasium names an environment: pictures are a tool above this package."""

Sees = Callable[[Reading], NDArray[np.uint8]]
"""From a reading to the picture (height, width, 3) of the world at that instant."""


def head_camera(world: World, size: tuple[int, int]) -> Sees:
    """What the robot sees with the camera in its head, in pictures of `size` (width, height) [pixels]. Raises
    TciError for one without pixels."""
    make: Any = load_env_creator(CAMERA)
    made: Sees = make(world, width=size[0], height=size[1])
    return made
