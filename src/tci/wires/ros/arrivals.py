"""Conversion of received ROS messages to TCI's types: joints, accelerations and skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.source_clock import SourceClock
from tci.errors import FrameError
from tci.messages import JointReading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.recording.schemas import to_gravity
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.wire_units import WireUnits

MOST_ORDERS = 32
"""Largest number of different lists of joint names that TCI stores for one robot. Assumed: a robot has fewer
publishers, and each publisher always sends the same list."""
SILENT = 0.1
"""Longest time [s] by which the latest acceleration may be older than the joint data. If the acceleration is
older, TCI does not use torques to detect touches. Assumed: in this time the robot's base leans by at most 6
degrees, which changes the torques by less than a touch does."""


def stamp_of(fields: Mapping[str, Any]) -> float:
    """Returns the time stamp [s] from a message's header."""
    return float(fields["sec"]) + float(fields["nanosec"]) * 1e-9


class JointArrivals:
    """Collects the JointState messages of one robot. The robot may have several publishers, each of which
    publishes some of the joints."""

    def __init__(self, robot: Robot, indices: Mapping[str, int]) -> None:
        """Stores the robot and `indices`. The keys of `indices` are joint names in ROS, and the values are
        indices of servos."""
        self._robot = robot
        self._names, self._units = indices, WireUnits(robot)
        self._orders: dict[tuple[str, ...], tuple[NDArray[np.intp], NDArray[np.intp]]] = {}
        self._clocks: dict[tuple[str, ...], SourceClock] = {}
        count = len(robot.servos)
        self._position, self._velocity = np.full(count, np.nan), np.zeros(count)
        self._torque = np.full(count, np.nan)
        self._stamps = np.full(count, -np.inf)
        self._sequence = 0
        self.latest: JointReading | None = None
        """The latest reading of all servos. The value is None until data of every servo has arrived."""

    @property
    def missing(self) -> list[str]:
        """Names of the servos for which no data has arrived yet."""
        return [servo.name for servo in self._robot.servos if np.isnan(self._position[servo.index])]

    def receive(self, fields: Mapping[str, Any], arrival: float) -> None:
        """Handles a JointState that arrived at `arrival` [s].

        Raises FrameError if the number of positions differs from the number of names. Also raises FrameError
        if velocities or efforts are not empty and their number differs from the number of names.
        """
        names = tuple(fields["name"])
        position, velocity, effort = fields["position"], fields["velocity"], fields["effort"]
        for what, values in (("velocity", velocity), ("effort", effort)):
            if len(values) not in (0, len(names)):
                raise FrameError(f"JointState: {len(names)} names, {len(values)} values of {what}")
        if len(position) != len(names):
            raise FrameError(f"JointState: {len(names)} names, {len(position)} values of position")
        servos, places = self._order(names)
        stamp = self._clocks[names].place(stamp_of(fields), arrival)
        if stamp is None or not len(servos):
            return
        new = self._units.angles(servos, np.asarray(position, dtype=float)[places])
        radius = self._units.radius[servos]
        if len(velocity):
            self._velocity[servos] = np.asarray(velocity, dtype=float)[places] / radius
        else:
            self._velocity[servos] = self._speed(servos, new, stamp)
        self._position[servos] = new
        if len(effort):
            self._torque[servos] = np.asarray(effort, dtype=float)[places] * radius
        self._stamps[servos] = stamp
        oldest = float(self._stamps.min())
        if oldest > -np.inf and (self.latest is None or oldest != self.latest.stamp):
            self._sequence += 1  # it belongs to the stamp: a message about other joints makes nothing newer
            self.latest = JointReading(
                stamp=oldest,
                sequence=self._sequence,
                position=read_only(self._position),
                velocity=read_only(self._velocity),
                torque=None if np.isnan(self._torque).all() else read_only(self._torque),
            )

    def _order(self, names: tuple[str, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns two arrays (k,) for the k servos that `names` contains: their indices in `Robot.servos`,
        and their indices in `names`. Raises FrameError if a joint is named twice."""
        if names not in self._orders:
            if len(self._orders) >= MOST_ORDERS:
                raise FrameError(f"JointState: more than {MOST_ORDERS} different lists of names")
            known = [(self._names[name], place) for place, name in enumerate(names) if name in self._names]
            servos = np.array([servo for servo, _ in known], dtype=np.intp)
            if len(set(servos.tolist())) != len(servos):
                raise FrameError(f"JointState: a joint is named twice: {', '.join(names)[:200]}")
            self._orders[names] = servos, np.array([place for _, place in known], dtype=np.intp)
            self._clocks[names] = SourceClock()
        return self._orders[names]

    def _speed(self, servos: NDArray[np.intp], position: Array, stamp: float) -> Array:
        """Returns speeds (k,) [rad/s] for a robot that sends none, computed from the change of the positions
        since the previous message; 0 for the first message."""
        passed = stamp - self._stamps[servos]
        moved = position - self._position[servos]
        known = np.isfinite(passed) & (passed > 0.0) & np.isfinite(moved)
        return np.where(known, moved / np.where(known, passed, 1.0), 0.0)


class ImuArrivals:
    """Collects accelerations of one robot from an accelerometer, which may be in any link of the robot."""

    def __init__(self, robot: Robot) -> None:
        self._kinematics = KinematicChain(robot) if robot.model is not None else None
        self._clock = SourceClock()
        self._stamp = -np.inf
        self._links: tuple[str, ...] = ()
        self._gravity: Array | None = None

    def receive(self, fields: Mapping[str, Any], arrival: float) -> None:
        """Handles an Imu message that arrived at `arrival` [s].

        Raises FrameError if the message has no acceleration, or if its frame is no link of the robot's model.
        """
        if self._kinematics is None:
            return
        gravity, root = to_gravity(fields), self._kinematics.links[0]
        # the definition of Imu uses -1 for a missing acceleration
        if gravity is None or fields["linear_acceleration_covariance"][0] == -1.0:
            raise FrameError("Imu: no acceleration")
        link = fields["frame_id"] or root
        if link not in self._kinematics.links:
            raise FrameError(f"Imu: the frame {link[:40]!r}; valid: a link of the model, such as {root}")
        stamp = self._clock.place(stamp_of(fields), arrival)
        if stamp is not None:
            self._stamp, self._links, self._gravity = stamp, (root, link), gravity

    def complete(self, joints: JointReading) -> JointReading:
        """Returns the joint reading and, if an Imu message has arrived, adds the direction of gravity in the
        root link.

        If Imu messages no longer arrive, the result has no torques, since TCI then can't compute which
        torques the weight of the links causes.
        """
        if self._gravity is None or self._kinematics is None:
            return joints
        if joints.stamp - self._stamp > SILENT:
            return replace(joints, torque=None)
        R_TR, R_TL = self._kinematics.pose_array(joints.position, self._links)[:, :3, :3]
        return replace(joints, gravity=read_only(R_TR.T @ R_TL @ self._gravity))


class SkinArrivals:
    """Collects the skin frames of one patch."""

    def __init__(self, robot: Robot, patch: str) -> None:
        self._patch = patch
        self._channels = robot.patch(patch).channels
        self._clock = SourceClock()
        self._sequence = 0
        self.latest: SkinFrame | None = None
        """The latest frame. The value is None until a frame has arrived."""

    def receive(self, fields: Mapping[str, Any], values: NDArray[np.generic], arrival: float) -> None:
        """Stores raw values that arrived at `arrival` [s] as the latest frame, unless they are outdated.
        `fields` contains their time stamp."""
        stamp = self._clock.place(stamp_of(fields), arrival)
        if stamp is None:
            return
        self._sequence += 1
        self.latest = SkinFrame(self._patch, stamp, self._sequence, values)
