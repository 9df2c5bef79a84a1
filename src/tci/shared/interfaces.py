"""Checks of the network interface to a robot, since the robot's DDS has no passwords."""

from __future__ import annotations

import socket
import struct
from ipaddress import IPv4Address
from pathlib import Path

from tci.errors import DriverError

CLASSES = Path("/sys/class/net")
"""Linux's folder with an entry for each network interface."""
ROUTES = Path("/proc/net/route")
"""Linux's table of routes."""
SIOCGIFADDR = 0x8915
"""Linux's request for the IPv4 address of an interface."""


def check_interface(
    name: str, *, force: bool = False, classes: Path = CLASSES, routes: Path = ROUTES
) -> None:
    """Raises DriverError if an interface does not exist, or if other machines may reach the interface. With
    `force`, only checks that the interface exists."""
    if not (classes / name).exists():
        there = sorted(path.name for path in classes.glob("*"))
        raise DriverError(f"there is no network interface {name}; valid: {', '.join(there) or 'none here'}")
    if not force and (why := exposure(name, classes=classes, routes=routes)):
        raise DriverError(
            f"{name} {why}: this DDS has no authentication, whoever reaches it can move the robot; "
            "valid: the interface of the robot's cable with an address such as 192.168.123.222, or "
            "?force=yes behind the address"
        )


def exposure(name: str, *, classes: Path = CLASSES, routes: Path = ROUTES) -> str:
    """Returns the reason why other machines may reach an interface. The text is empty for the loopback
    interface and for a private cable."""
    if (classes / name / "wireless").exists() or (classes / name / "phy80211").exists():
        return "is a wireless network"
    if routes.exists():
        for line in routes.read_text().splitlines()[1:]:
            interface, target, *_ = line.split()
            if interface == name and int(target, 16) == 0:
                return "leads to the default route"
    address = address_of(name)
    if address is not None and address.is_global:
        return f"has the public address {address}"
    return ""


def address_of(name: str) -> IPv4Address | None:
    """Returns the IPv4 address of an interface, or None if the interface has no address."""
    from fcntl import ioctl  # only Linux and macOS have fcntl

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            answer = ioctl(probe, SIOCGIFADDR, struct.pack("256s", name.encode()[:15]))
        except OSError:
            return None
    return IPv4Address(answer[20:24])


def is_loopback(name: str) -> bool:
    """Returns True for the loopback interface, which only this machine reaches."""
    address = address_of(name)
    return address is not None and address.is_loopback
