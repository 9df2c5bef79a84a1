"""Addresses of robots that other processes serve: `[NAME@][WHERE]`. NAME is the robot's name on the network,
WHERE an address in the middleware's own form."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tci.errors import DriverError
from tci.robot.description import wire_name

LONGEST = 32
"""Largest length of a robot's name on the network. The name is a part of the names of LCM's channels, which
may have at most 63 characters."""


@dataclass(frozen=True, slots=True)
class RemoteAddress:
    """Address of a served robot."""

    middleware: str
    robot: str
    """Name of the robot on the network. The name distinguishes several robots on one network."""
    where: str
    """Address in the middleware's own form."""

    def __str__(self) -> str:
        return f"{self.middleware}:{self.robot}@{self.where}"


def parse_remote(middleware: str, text: str, robot: str, where: str) -> RemoteAddress:
    """Parses an address `[NAME@][WHERE]`. The defaults for NAME and WHERE are `robot` and `where`. Raises
    DriverError for an invalid NAME."""
    name, at, place = text.rpartition("@")
    name = name if at else wire_name(robot)[:LONGEST]
    if not re.fullmatch(rf"[A-Za-z0-9_-]{{1,{LONGEST}}}", name):
        raise DriverError(
            f"{middleware}: the robot's name {name!r}; valid: 1 to {LONGEST} letters, digits, _ and -"
        )
    return RemoteAddress(middleware, name, place or where)
