"""DDS domains that are open in this process. Within one process, the DDS library Cyclone accepts only one
configuration for each domain."""

from __future__ import annotations

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain

from tci.errors import DriverError

MOST_PARTICIPANTS = 32
"""Largest number of processes on this machine that can discover each other in one domain without multicast.
ROS has an equal limit."""
_open: dict[int, tuple[Domain, str, int]] = {}
"""Open DDS domains by domain number. Each value has the domain, its user (the part of TCI that opened it,
such as `ROS 2`), and the number of uses that `close_domain` has not ended yet."""


def open_domain(number: int, settings: str, user: str) -> None:
    """Opens the DDS domain `number`. `settings` is the configuration of Cyclone. `user` is the part of TCI
    that uses the domain, for example `ROS 2`. If the domain is open for `user` already, only counts the call.
    Raises DriverError if Cyclone refuses the settings, or if the domain is open for another user than `user`.
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
    """Ends one use of a domain. Call this function once for each call of `open_domain`; the last call closes
    the domain."""
    domain, user, count = _open.pop(number)
    if count > 1:
        _open[number] = domain, user, count - 1
