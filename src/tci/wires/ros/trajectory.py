"""Execution of a trajectory that was received through ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.controllers import position_order
from tci.errors import CommandError
from tci.messages import PlatformCommand
from tci.messages.frames import Array
from tci.robot.wire_units import WireUnits

MOST_POINTS = 10_000
"""Largest number of points of one trajectory, to bound the used memory. Assumed: trajectories have at most
100 points per second and last at most 100 s."""


class Trajectory:
    """A JointTrajectory in execution, interpolated linearly between its points."""

    def __init__(
        self,
        part: str,
        servos: Mapping[str, int],
        fields: Mapping[str, Any],
        units: WireUnits,
        position: Array,
        now: float,
    ) -> None:
        """Starts a trajectory at the time `now` [s] from the robot's `position` (n_servos,) [rad].

        `servos` are the indices of all servos of the part by joint name, `fields` the received message in
        `units`. A message without points stops the joints that are named in the message. A message without
        points and without joint names stops all joints of the part.

        Raises CommandError if a joint does not belong to the part or is named twice, or if there are too many
        points. Also raises CommandError if a position is missing or not finite, or if the times do not
        increase.
        """
        names, points = fields["joint_names"], fields["points"]
        self._of = f"trajectory for {part}"
        if unknown := [name for name in names if name not in servos]:
            raise CommandError(f"{self._of}: no joint {unknown[0][:60]!r}; valid: {', '.join(servos)}")
        if len(set(names)) != len(names):
            raise CommandError(f"{self._of}: a joint is named twice: {', '.join(names)}")
        if len(points) > MOST_POINTS:
            raise CommandError(f"{self._of}: {len(points)} points; valid: at most {MOST_POINTS}")
        chosen = [servos[name] for name in names or (servos if not len(points) else ())]
        self.servos: NDArray[np.intp] = np.array(chosen, dtype=np.intp)
        times, places = [0.0], [np.asarray(position)[self.servos]]
        for number, point in enumerate(points):
            place = np.asarray(point["positions"], dtype=float)
            if place.shape != (len(names),) or not np.isfinite(place).all():
                found = f"{self._of}, point {number}: {len(place)} positions"
                raise CommandError(f"{found}; valid: {len(names)} finite ones")
            when = point["time_from_start"]["sec"] + point["time_from_start"]["nanosec"] * 1e-9
            if when < times[-1] or (number and when == times[-1]):
                raise CommandError(f"{self._of}, point {number}: at {when:g} s, after {times[-1]:g} s")
            times.append(when)
            places.append(units.angles(self.servos, place))
        self._start, self._times, self._places = now, np.array(times), np.array(places)
        self._done = False

    def order(self, now: float) -> PlatformCommand | None:
        """Returns the set-points of the trajectory's joints at `now` [s], or None after the end of the
        trajectory."""
        if self._done:
            return None
        passed = now - self._start
        self._done = passed >= self._times[-1]
        values = np.array([np.interp(passed, self._times, column) for column in self._places.T])
        if self._done:
            values = self._places[-1]
        return position_order(self.servos, values)
