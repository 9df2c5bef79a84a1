"""Addresses of Unitree robots: `INTERFACE[/DOMAIN][?OPTION=VALUE&...]`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import parse_qsl

from tci.drivers.unitree.network import check_interface
from tci.errors import DriverError

VALID = "valid: INTERFACE[/DOMAIN], such as eth0 or lo/1, then ?control=all, ?force=yes or ?simulation=yes"
CHOICES = {"control": ("arms", "all"), "force": ("no", "yes"), "simulation": ("no", "yes")}
"""Options and their values, the usual one first."""


@dataclass(frozen=True, slots=True)
class UnitreeAddress:
    """One robot's network."""

    interface: str
    """Name of the network interface with the robot's cable."""
    domain: int = 0
    """DDS domain; the robot's is 0."""
    whole: bool = False
    """True to command all motors over rt/lowcmd, without the robot's own controller, which keeps its
    balance."""
    force: bool = False
    """True to use an interface that others may reach."""
    simulation: bool = False
    """True to accept states without checksum and variant, as the vendor's simulation in Python sends
    them."""

    def __str__(self) -> str:
        return f"{self.interface}/{self.domain}"

    @property
    def topic(self) -> str:
        """Topic of the commands."""
        return "rt/lowcmd" if self.whole else "rt/arm_sdk"


def parse_unitree(address: str, *, usual: str = "") -> UnitreeAddress:
    """Returns the parts of an address, `usual` if it is empty, after a check of its interface.

    Raises DriverError for an address of another form, and for an interface that is missing or that others
    may reach.
    """
    place, _, options = (address or usual).partition("?")
    found = re.fullmatch(r"([A-Za-z0-9_.:@-]{1,15})(?:/(\d{1,3}))?", place)
    if found is None or int(found[2] or 0) > 232:
        missing = "the interface of the robot's cable is missing" if not place else repr(place)
        raise DriverError(f"unitree: {missing}; {VALID}")
    chosen = {name: values[0] for name, values in CHOICES.items()}
    for name, value in parse_qsl(options, keep_blank_values=True):
        if value not in CHOICES.get(name, ()):
            raise DriverError(f"unitree: {name}={value}; {VALID}")
        chosen[name] = value
    where = UnitreeAddress(
        found[1], int(found[2] or 0), whole=chosen["control"] == "all", force=chosen["force"] == "yes",
        simulation=chosen["simulation"] == "yes",
    )  # fmt: skip
    check_interface(where.interface, force=where.force)
    return where
