"""Point clouds of the skin, with which other programs show a recording."""

from __future__ import annotations

import numpy as np

from tci.errors import TciError
from tci.messages import Perception
from tci.recording.rosmsg.cdr import encode
from tci.recording.schemas import CLOUD, cloud_fields, header
from tci.robot.description import Robot
from tci.skin.skin import Skin

RATE = 10.0
"""Rate [Hz] of the clouds: enough to look at, as every raw frame is also recorded."""
FINEST = 2.0**-13
"""Resolution [m] to which the points of a cloud are rounded (0.12 mm). Rounded points compress better."""


class Clouds:
    """Draws the whole skin with its pressure, in the torso frame."""

    def __init__(self, robot: Robot) -> None:
        """Raises the errors of `Skin`."""
        self._skin = Skin(robot)
        self._names = [patch.name for patch in robot.patches]
        self._due = -np.inf

    def draw(self, now: float, perception: Perception) -> bytes | None:
        """Returns a PointCloud2 for the time `now` [s]. None between two clouds, and without skin."""
        if now < self._due or perception.skin is None or perception.joints is None:
            return None
        pressures = perception.skin.by_patch(self._names)
        if not pressures:
            return None
        try:
            points = [self._skin.positions(name, perception.joints, frame="torso") for name in pressures]
        except TciError:  # joints that do not fit the robot
            return None
        self._due = now + 1.0 / RATE - 1e-6
        pressure = np.concatenate([*pressures.values()])
        cloud = np.empty((len(pressure), 4), dtype="<f4")
        cloud[:, :3] = np.round(np.concatenate(points) / FINEST) * FINEST
        cloud[:, 3] = pressure
        return encode(CLOUD, (*header(now, "torso"), *cloud_fields(cloud)))
