"""How fast a part may move so that it strikes nobody on its way harder than people may be struck."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np

from tci.body.retreat import Retreat
from tci.errors import DescriptionError
from tci.messages.frames import Array
from tci.robot.blow import Striker, Strikers, Struck, spared
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration

MARGIN = 1.1
"""Factor on the predicted force. References keep 15 % below the asked speed besides. Blows on a simulated
robot whose servos and masses are not known were 0.8 to 1.2 times as hard."""
AT = (0.5, 1.0)
"""Fractions of the way at which a blow is predicted: where the part is fastest, and where it is farthest."""


class Pace(NamedTuple):
    """How fast a part moves, and what that means for whoever stands in its way."""

    share: float
    """Fraction of the fastest motion, above 0 and at most 1."""
    speed: float | None
    """Largest speed [rad/s] of any of its generic joints; None for the robot's own limits."""
    force: float
    """Force [N] that no blow exceeds; infinite if the robot's masses are unknown."""


UNBOUNDED = Pace(1.0, None, np.inf)
"""The robot's own limits, and no bound on blows."""


class Paces:
    """Predicts blows of one robot. Threads may share it."""

    def __init__(self, robot: Robot, retreat: Retreat) -> None:
        self._retreat, self._lock, self._strikers = retreat, Lock(), Strikers(robot)
        try:
            self._dynamics: Dynamics | None = Dynamics(robot, JointCalibration(robot=robot.name))
        except DescriptionError:  # no model, or no masses
            self._dynamics = None

    def pace(
        self, position: Array, part: str, posture: Array, target: Array, people: Sequence[Struck]
    ) -> Pace:
        """The pace for a motion of `part` from `posture` to `target`, both (n,) [rad], that spares `people`.
        The servos are at `position` (n_servos,) [rad]."""
        if not people:
            return UNBOUNDED
        servos, way, most = self._retreat.fastest(position, part, target)
        if self._dynamics is None or not np.isfinite(most) or not np.abs(way).max(initial=0.0) > 1e-4:
            return UNBOUNDED
        rates, own = np.zeros(len(position)), {*servos.tolist()}
        rates[servos] = way * most
        blows: list[tuple[Striker, float]] = []
        for at in AT:
            there = position.copy()
            there[servos] += at * way
            with self._lock:
                inertia, _ = self._dynamics.at(there, np.zeros(len(there)))
                centres = self._dynamics.centres(own)
            velocities = centres @ rates
            speeds = np.sqrt((velocities**2).sum(axis=1)).tolist()
            for moved, velocity, speed in zip(centres, velocities, speeds, strict=True):
                if speed > 1e-3 and (one := self._strikers.behind(inertia, velocity / speed @ moved)):
                    blows.append((one, speed))
        share, force = spared(blows, people, margin=MARGIN)
        if share >= 1.0:
            return Pace(1.0, None, MARGIN * force)
        speed = float(np.abs(target - posture).max()) * most * share
        return Pace(share, speed, MARGIN * force)
