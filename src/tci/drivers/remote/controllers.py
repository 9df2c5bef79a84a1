"""Controllers of a robot that is served in the protocol of another middleware. Each accepts orders for one
part.

Each counts as one commander among the TCI processes, so a joint is commanded by one of them at a time.
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
from tci.frames import Array
from tci.messages import Mode, PlatformCommand
from tci.reasons import Reason
from tci.robot.description import Robot, Servo

KEEP = 1.0
"""Time [s] for which a part stays under command after its last order, so that it comes to rest. Assumed:
longer than a stop takes."""
MOST = 16
"""Largest number of messages that are handled between two periods. Assumed: a client sends about one in each
period."""


class Source(Protocol):
    """The set-points that a controller follows."""

    def order(self, now: float) -> PlatformCommand | None:
        """Returns the set-points of its joints at `now` [s]; None when it is over."""
        ...


Make = Callable[[Array, float], Source]
"""Makes a source, from a position (n_servos,) [rad] at a time [s]. Raises CommandError."""


class Once:
    """A single order."""

    def __init__(self, order: PlatformCommand) -> None:
        self._left: PlatformCommand | None = order

    def order(self, now: float) -> PlatformCommand | None:
        """Returns the order the first time, then None."""
        found, self._left = self._left, None
        return found


class PartControllers:
    """The controllers of one robot, one per part."""

    def __init__(self, robot: Robot, session: int, *, of: str) -> None:
        """Takes the server's number `session`; `of` names the clients, for messages."""
        parts = dict.fromkeys(servo.robot_part for servo in robot.servos)
        self._parts = {part: _Part(robot, f"{of}, for {part}", session) for part in parts}
        self._arrived: deque[tuple[str, Make]] = deque(maxlen=MOST)
        self._refused: list[Reason] = []

    def start(self, part: str, make: Make) -> None:
        """Starts a new source for a part; it replaces the previous one."""
        self._arrived.append((part, make))

    def messages(self, position: Array, now: float) -> Iterator[Orders]:
        """Yields the controllers' orders at `now` [s], with the robot at `position` (n_servos,) [rad]."""
        while self._arrived:
            part, make = self._arrived.popleft()
            try:
                self._parts[part].source = make(position, now)
            except CommandError as error:
                self._refused.append(error.reason)
        for controller in self._parts.values():
            yield from controller.messages(now)

    def refusals(self, commanders: Iterable[Commander]) -> list[Reason]:
        """Returns the reasons for refusals since the last call."""
        found, self._refused = self._refused, []
        for commander in commanders:
            for controller in self._parts.values():
                if commander.client == controller.client and commander.refused > controller.refused:
                    controller.refused = commander.refused
                    found += [commander.reason] if commander.reason is not None else []
        return found


class _Part:
    """The controller of one part."""

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
    """Returns a command of positions [rad], as fast as the gate allows."""
    return PlatformCommand(
        mode=Mode.POSITION, servos=servos, values=values, speed=np.full(len(servos), math.inf)
    )


def values_order(robot_part: str, servos: tuple[Servo, ...], data: Any) -> PlatformCommand:
    """Returns a command of positions [rad] of all servos of a part. Raises CommandError for another count, or
    no numbers."""
    values = np.asarray(data, dtype=float)
    if values.shape != (len(servos),) or not np.isfinite(values).all():
        found = f"commands for {robot_part}: {len(values)} values"
        raise CommandError(f"{found}; valid: {len(servos)} finite ones")
    return position_order(np.array([servo.index for servo in servos], dtype=np.intp), values)


def movable(order: PlatformCommand, robot: Robot) -> PlatformCommand:
    """Removes joints that the gate can't move, since a message for a whole part contains them too."""
    limits = (robot.servos[servo].limits for servo in order.servos)
    known = [None not in (s.lower, s.upper, s.velocity, s.acceleration, s.jerk) for s in limits]
    return position_order(order.servos[known], order.values[known])
