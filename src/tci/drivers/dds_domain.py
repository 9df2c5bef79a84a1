"""DDS domains that are open in this process. The DDS library Cyclone accepts one configuration per domain."""

from __future__ import annotations

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain

from tci.errors import DriverError

MOST_PARTICIPANTS = 32
"""Largest number of processes on this machine that can find each other in one domain without multicast. ROS
has the same limit."""
_open: dict[int, tuple[Domain, str, int]] = {}
"""Open domains by number: the domain, its user, and how many times it was opened."""


def open_domain(number: int, settings: str, user: str) -> None:
    """Opens domain `number` for `user`, for example `ROS 2`, with `settings` for Cyclone.

    If `user` has opened this domain before, the open domain is used again.

    Raises DriverError if Cyclone refuses the settings, or if another user has the domain open.
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
    """Undoes one call of `open_domain`. Undoing the last call closes the domain."""
    domain, user, count = _open.pop(number)
    if count > 1:
        _open[number] = domain, user, count - 1
