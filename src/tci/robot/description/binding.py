"""How a middleware reaches the robot."""

from __future__ import annotations

from tci.robot.description.base import Description


class Address(Description):
    """Where a middleware finds one thing of the robot."""

    of: str
    """Name of a patch, of a robot part or of a servo."""
    to: str
    """Its port, topic, key or name there."""


class Binding(Description):
    """How one middleware reaches the robot."""

    middleware: str
    """Name of the link: `sim`, `yarp`, `naoqi`, ..."""
    rate: float
    """Commands per second [Hz]."""
    stale_after: float
    """Age [s] beyond which joint data no longer counts, and the gate holds."""
    addresses: tuple[Address, ...] = ()
    """Things that are not found under the middleware's usual names."""

    def address(self, of: str, usual: str) -> str:
        """Where the patch, robot part or servo named `of` is found; `usual` where the file says nothing."""
        return next((address.to for address in self.addresses if address.of == of), usual)
