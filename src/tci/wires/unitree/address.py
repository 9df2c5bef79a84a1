"""Addresses of Unitree robots: `INTERFACE[/DOMAIN][?OPTION=VALUE&...]`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import parse_qsl

from tci.errors import DriverError
from tci.shared.interfaces import check_interface

VALID = "valid: INTERFACE[/DOMAIN], such as eth0 or lo/1, then ?control=all, ?force=yes or ?simulation=yes"
CHOICES = {"control": ("arms", "all"), "force": ("no", "yes"), "simulation": ("no", "yes")}
"""Options of an address and their valid values. The first value is the default."""


@dataclass(frozen=True, slots=True)
class UnitreeAddress:
    """The network interface and the DDS domain of a robot, and options of the connection."""

    interface: str
    """Name of the network interface that the robot's cable is connected to."""
    domain: int = 0
    """DDS domain; a real robot has domain 0."""
    whole: bool = False
    """True to command all motors over rt/lowcmd. The robot's own controller is then off, and the robot does
    not keep its balance by itself."""
    force: bool = False
    """True to permit an interface that other machines may reach; by default, DriverError is raised for it."""
    simulation: bool = False
    """True to accept states without checksum and without the robot's variant (`mode_machine`). The vendor's
    Python simulation sends such states."""

    def __str__(self) -> str:
        return f"{self.interface}/{self.domain}"

    @property
    def topic(self) -> str:
        """DDS topic of the commands to the motors."""
        return "rt/lowcmd" if self.whole else "rt/arm_sdk"


def parse_unitree(address: str, *, usual: str = "") -> UnitreeAddress:
    """Parses an address and checks the network interface. An empty address has the value `usual`.

    Raises DriverError if the address is invalid, if the interface does not exist, or if machines that the
    operator did not permit can reach the interface.
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
