"""Controllers of a robot that is served in the protocol of another middleware.

Each controller accepts orders for one robot part. Each controller counts as one commander, as a TCI process
does. Therefore only one controller or process commands a joint at a time.
"""

from __future__ import annotations

import math
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.protocol import Commander, Orders
from tci.errors import CommandError
from tci.messages import Mode, PlatformCommand
from tci.messages.frames import Array
from tci.reasons import Reason
from tci.robot.description import Robot, Servo
from tci.robot.wire_units import WireUnits

KEEP = 1.0
"""Time [s] for which a part stays under command after its last order, so that the part comes to rest.
Assumed: stopping takes less time."""
MOST = 16
"""Largest number of messages that are handled in one period. Assumed: a client sends about one message per
period."""


class Source(Protocol):
    """The set-points that a controller follows."""

    def order(self, now: float) -> PlatformCommand | None:
        """Returns the controller's set-points at the time `now` [s], or None after the last set-point."""
        ...


Make = Callable[[Array, float], Source]
"""Function that makes a source of set-points. Its arguments are the robot's position (n_servos,) [rad] and
the time [s]. The function raises CommandError if it refuses the order."""


class Once:
    """A `Source` of set-points that contains a single order."""

    def __init__(self, order: PlatformCommand) -> None:
        self._left: PlatformCommand | None = order

    def order(self, now: float) -> PlatformCommand | None:
        """Returns the order at the first call, then None."""
        found, self._left = self._left, None
        return found


class PartControllers:
    """The controllers of one robot, one controller per robot part."""

    def __init__(self, robot: Robot, session: int, *, of: str) -> None:
        """Creates the controllers. `session` is the session number of the server. `of` names the clients in
        messages to the user, for example "a ROS node"."""
        parts = dict.fromkeys(servo.robot_part for servo in robot.servos)
        self._parts = {part: _Part(robot, f"{of}, for {part}", session) for part in parts}
        self._arrived: deque[tuple[str, Make]] = deque(maxlen=MOST)
        self._refused: list[Reason] = []

    def start(self, part: str, make: Make) -> None:
        """Lets the controller of `part` follow the set-points that `make` creates, in place of its previous
        set-points."""
        self._arrived.append((part, make))

    def messages(self, position: Array, now: float) -> Iterator[Orders]:
        """Yields the controllers' orders at `now` [s]. `position` (n_servos,) [rad] is the robot's
        position."""
        while self._arrived:
            part, make = self._arrived.popleft()
            try:
                self._parts[part].source = make(position, now)
            except CommandError as error:
                self._refused.append(error.reason)
        for controller in self._parts.values():
            yield from controller.messages(now)

    def refusals(self, commanders: Iterable[Commander]) -> list[Reason]:
        """Returns the reasons for which orders were refused since the last call."""
        found, self._refused = self._refused, []
        for commander in commanders:
            for controller in self._parts.values():
                if commander.client == controller.client and commander.refused > controller.refused:
                    controller.refused = commander.refused
                    found += [commander.reason] if commander.reason is not None else []
        return found


class _Part:
    """Controller of one robot part, which counts as one commander of the robot."""

    def __init__(self, robot: Robot, name: str, session: int) -> None:
        self.client = secrets.randbits(62) + 1
        self.refused = 0
        self.source: Source | None = None
        self._robot, self._name, self._session = robot, name, session
        self._until: float | None = None
        self._sequence = self._count = 0

    def messages(self, now: float) -> Iterator[Orders]:
        order = self.source.order(now) if self.source is not None else None
        if order is None:
            self.source = None
        else:
            self._until = now + KEEP
        if self._until is None:
            return
        leaving = now > self._until
        if leaving:
            self._until = None
        self._sequence += 1
        orders = () if order is None else (movable(order, self._robot),)
        self._count += len(orders)
        yield Orders(
            session=self._session, seen=time.monotonic(), client=self.client, name=self._name,
            sequence=self._sequence, halt=None, leaving=leaving, first=self._count, orders=orders,
        )  # fmt: skip


def position_order(servos: NDArray[np.intp], values: Array) -> PlatformCommand:
    """Returns a command to move servos to positions [rad] as fast as the gate allows."""
    return PlatformCommand(
        mode=Mode.POSITION, servos=servos, values=values, speed=np.full(len(servos), math.inf)
    )


def values_order(
    robot_part: str, servos: tuple[Servo, ...], data: Any, units: WireUnits | None = None
) -> PlatformCommand:
    """Returns a command to move all servos of a robot part to the places of `data`, in `units` or [rad].

    Raises CommandError if the number of values is wrong or a value is not finite.
    """
    values = np.asarray(data, dtype=float)
    if values.shape != (len(servos),) or not np.isfinite(values).all():
        found = f"commands for {robot_part}: {len(values)} values"
        raise CommandError(f"{found}; valid: {len(servos)} finite ones")
    index = np.array([servo.index for servo in servos], dtype=np.intp)
    return position_order(index, values if units is None else units.angles(index, values))


def movable(order: PlatformCommand, robot: Robot) -> PlatformCommand:
    """Returns the command without the joints that the gate can't move.

    Reason: messages for a whole part also contain such joints.
    """
    limits = (robot.servos[servo].limits for servo in order.servos)
    known = [None not in (s.lower, s.upper, s.velocity, s.acceleration, s.jerk) for s in limits]
    return position_order(order.servos[known], order.values[known])
