"""How fast a part may move so that it strikes nobody on its way harder than people may be struck."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np

from tci.body.retreat import Retreat
from tci.errors import DescriptionError
from tci.messages.frames import Array
from tci.robot.blow import Struck, drives_of, spared
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration
from tci.robot.joint_map import joint_map
from tci.robot.kernels.blow import strikes

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
        self._retreat, self._lock, self._dynamics = retreat, Lock(), None
        try:
            self._dynamics = dynamics = Dynamics(robot, JointCalibration(robot=robot.name))
        except DescriptionError:  # no model, or no masses
            return
        drives = drives_of(robot)
        self._drives = drives._replace(
            torques=dynamics.by_freedom(drives.torques),
            accelerations=dynamics.by_freedom(drives.accelerations),
        )
        self._links = {
            part.name: dynamics.links(joint_map(robot, part.name).servos.tolist()) for part in robot.parts
        }

    def pace(
        self, position: Array, part: str, posture: Array, target: Array, people: Sequence[Struck]
    ) -> Pace:
        """The pace for a motion of `part` from `posture` to `target`, both (n,) [rad], that spares `people`.
        The servos are at `position` (n_servos,) [rad]."""
        if not people or self._dynamics is None:
            return UNBOUNDED
        servos, way, most = self._retreat.fastest(position, part, target)
        if not np.isfinite(most) or not np.abs(way).max(initial=0.0) > 1e-4:
            return UNBOUNDED
        rates = np.zeros(len(position))
        rates[servos] = way * most
        rates, links, count = self._dynamics.by_freedom(rates), self._links[part], 0
        moved, room = np.empty((2, 3, len(rates))), np.empty((len(rates), len(rates) + 1))
        blows = np.empty((len(AT) * len(links.bodies), 5))
        for at in AT:
            there = position.copy()
            there[servos] += at * way
            with self._lock:
                posed = self._dynamics.posed(there)
                count += strikes(posed, links, self._drives, rates, moved, room, blows[count:])
        share, force = spared(blows[:count], people, margin=MARGIN)
        if share >= 1.0:
            return Pace(1.0, None, MARGIN * force)
        speed = float(np.abs(target - posture).max()) * most * share
        return Pace(share, speed, MARGIN * force)
