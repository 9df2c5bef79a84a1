"""Bindings: rate, staleness limit and addresses of the robot in one middleware."""

from __future__ import annotations

import re
from collections.abc import Mapping

from tci.robot.description.base import Description


class Address(Description):
    """Address of a patch, part or servo in a middleware."""

    of: str
    """Name of a patch, of a robot part or of a servo."""
    to: str
    """Port, topic, key or name in the middleware."""
    channels: int | None = None
    """Number of values that a patch has there, if it is more than its channels (YARP)."""
    modules: tuple[int, ...] = ()
    """Modules among these values that contain the patch's channels, in order. A module has twelve values, of
    which ten are taxels."""


class Binding(Description):
    """Connection parameters of the robot for one middleware."""

    middleware: str
    """Name of the driver: `sim`, `yarp`, `naoqi`, ..."""
    rate: float
    """Commands per second [Hz]."""
    stale_after: float
    """Age [s] above which joint data no longer counts and the gate holds."""
    addresses: tuple[Address, ...] = ()
    """Addresses that differ from the middleware's usual names."""

    def address(self, of: str, usual: str) -> str:
        """Returns the address of the patch, robot part or servo named `of`, or `usual` if the description has
        none."""
        entry = self.entry(of)
        return usual if entry is None else entry.to

    def entry(self, of: str) -> Address | None:
        """Returns the address element for the patch, robot part or servo named `of`; None if there is
        none."""
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
"""Default bindings, for each middleware that can carry any robot. Assumed: rates that the middleware can
sustain, and staleness limits of a few messages (docs/tables/middleware.md)."""


def wire_name(name: str, *, dash: bool = True) -> str:
    """Returns a name of a description as a part of an address: letters, digits, `_` and, if allowed, `-`.

    Every other character becomes `_`. A name that would begin with a digit gets a `_` before it.
    """
    found = re.sub(r"[^A-Za-z0-9_-]" if dash else r"[^A-Za-z0-9_]", "_", name)
    return f"_{found}" if found[0].isdigit() else found
