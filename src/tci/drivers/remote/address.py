"""Addresses of robots that other processes show: `[NAME@][WHERE]`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tci.errors import DriverError


@dataclass(frozen=True, slots=True)
class RemoteAddress:
    """Which robot, and where."""

    middleware: str
    robot: str
    """Its name on the network, by which several are told apart."""
    where: str
    """What the middleware needs to know."""

    def __str__(self) -> str:
        return f"{self.middleware}:{self.robot}@{self.where}"


def parse_remote(middleware: str, text: str, robot: str, where: str) -> RemoteAddress:
    """An address; `robot` and `where` count where it says nothing. Raises DriverError for a bad name."""
    name, at, place = text.rpartition("@")
    name = name if at else robot
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name):
        raise DriverError(f"{middleware}: the robot's name {name!r}; valid: 1 to 32 letters, digits, _ and -")
    return RemoteAddress(middleware, name, place or where)
