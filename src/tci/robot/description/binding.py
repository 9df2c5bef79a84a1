"""Bindings: the command rate, the age limit of joint data and the addresses of a robot in one middleware."""

from __future__ import annotations

import re
from collections.abc import Mapping

from tci.robot.description.base import Description


class Address(Description):
    """Address of a patch, a robot part or a servo in a middleware."""

    of: str
    """Name of a patch, of a robot part or of a servo."""
    to: str
    """Port, topic, key or name in the middleware."""
    channels: int | None = None
    """Number of values in the middleware's message for a patch, if the message has more values than the patch
    has channels (YARP)."""
    modules: tuple[int, ...] = ()
    """Modules of the message that contain the patch's channels, each by its number, in the order of the
    channels. A module has twelve values; ten of them are taxels."""


class Binding(Description):
    """Connection parameters of the robot for one middleware."""

    middleware: str
    """Name of the driver: `sim`, `yarp`, `naoqi`, ..."""
    rate: float
    """Number of commands per second [Hz]."""
    stale_after: float
    """Age [s] of joint data above which the gate stops the robot until newer data arrives."""
    addresses: tuple[Address, ...] = ()
    """Addresses that differ from the names that the middleware usually uses."""
    sources: tuple[str, ...] = ()
    """Hands and loose sensors of this robot, `NAME:ADDRESS,option=value` each. `connect` adds them to this
    middleware's driver if it is given no source."""

    def address(self, of: str, usual: str) -> str:
        """Returns the address of the patch, robot part or servo named `of`. If the description has no address
        for it, returns `usual`."""
        entry = self.entry(of)
        return usual if entry is None else entry.to

    def entry(self, of: str) -> Address | None:
        """Returns the address element for the patch, robot part or servo named `of`; None if the description
        has no such element."""
        return next((address for address in self.addresses if address.of == of), None)


USUAL: Mapping[str, Binding] = {
    name: Binding(middleware=name, rate=rate, stale_after=stale_after)
    for name, rate, stale_after in (
        ("sim", 500.0, 0.05),
        ("zenoh", 200.0, 0.08),
        ("lcm", 200.0, 0.08),
        ("yarp", 200.0, 0.08),
        ("ros2", 100.0, 0.08),
        ("ros1", 100.0, 0.08),
        ("rosbridge", 25.0, 0.08),
        ("player", 100.0, 0.08),
    )
}
"""Default bindings of the middlewares that work with any robot. Assumed: rates that the middleware can
sustain, and age limits of a few message periods (docs/tables/middleware.md)."""


def wire_name(name: str, *, dash: bool = True) -> str:
    """Returns a name of a description in a form for addresses: only letters, digits, `_` and, if `dash` is
    True, `-`.

    All other characters are replaced by `_`. If the result would begin with a digit, a `_` is put before this
    digit.
    """
    found = re.sub(r"[^A-Za-z0-9_-]" if dash else r"[^A-Za-z0-9_]", "_", name)
    return f"_{found}" if found[0].isdigit() else found
