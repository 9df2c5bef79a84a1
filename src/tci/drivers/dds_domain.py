"""DDS domains in this process. Cyclone accepts one configuration for each domain."""

from __future__ import annotations

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain

from tci.errors import DriverError

MOST_PARTICIPANTS = 32
"""Largest number of processes of one domain on this machine that can find each other without multicast, as in
ROS."""
_open: dict[int, tuple[Domain, str, int]] = {}
"""Domain, its user and number of openings, by number."""


def open_domain(number: int, settings: str, user: str) -> None:
    """Opens a domain with Cyclone's `settings`, or shares the domain that the same `user`, such as `ROS 2`,
    has open.

    Raises DriverError for settings that Cyclone refuses, and for the domain of another user.
    """
    if number in _open:
        domain, other, count = _open[number]
        if other != user:
            raise DriverError(
                f"{user}: DDS domain {number} is open in this process for {other}, on another network; "
                "valid: another domain, by ROS_DOMAIN_ID or unitree:INTERFACE/DOMAIN"
            )
        _open[number] = domain, user, count + 1
        return
    try:
        _open[number] = Domain(number, settings), user, 1
    except DDSException as error:
        raise DriverError(f"{user} domain {number} can't be opened: {error}") from error


def close_domain(number: int) -> None:
    """Closes what `open_domain` has opened."""
    domain, user, count = _open.pop(number)
    if count > 1:
        _open[number] = domain, user, count - 1
