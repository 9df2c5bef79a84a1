"""Bindings: rate, staleness limit and addresses of the robot in one middleware."""

from __future__ import annotations

from tci.robot.description.base import Description


class Address(Description):
    """Address of a patch, part or servo in a middleware."""

    of: str
    """Name of a patch, of a robot part or of a servo."""
    to: str
    """Port, topic, key or name in the middleware."""


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
        """Returns the address of the patch, robot part or servo named `of`, or `usual` if the file gives
        none."""
        return next((address.to for address in self.addresses if address.of == of), usual)
