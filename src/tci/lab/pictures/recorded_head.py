"""What the head of a recorded robot saw."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tci.lab.pictures.film import world_of
from tci.lab.pictures.head_camera import HeadCamera
from tci.messages import Reading
from tci.recording.recording import Recording
from tci.recording.schemas import to_nanoseconds
from tci.robot.description import Robot


def recorded_head(
    recording: Recording, robot: Robot, *, width: int, height: int
) -> Callable[[float, Reading], NDArray[np.uint8]]:
    """From the time [s] and the reading of a period to the picture (height, width, 3), drawn from the
    recorded angles and from what touched a simulated robot. Around a real one nothing is known, so it sees
    only itself.

    Raises the errors of `HeadCamera`, RecordingError for damaged data.
    """
    world, truth = world_of(recording, robot)
    camera = HeadCamera(world, width=width, height=height)

    def picture(now: float, reading: Reading) -> NDArray[np.uint8]:
        world.show(reading.joints.position)
        return camera.picture(reading, truth.get(to_nanoseconds(now), {}))

    return picture
