"""Unique names of hosts. Servers use these names to count the connections of each host."""

from __future__ import annotations

import socket
from ipaddress import ip_address


def numeric(host: str) -> str:
    """Returns the numeric address of a host. The result is equal for all names of one host.

    - For every loopback address, the result is 127.0.0.1.
    - If a host has several addresses, the lowest address is returned, and an IPv4 address before IPv6.
    - A name that can't be resolved is returned unchanged.
    - `localhost` is never looked up, because /etc/hosts lacks this name on some machines.

    The function waits for the network only if `host` is a name other than `localhost`.
    """
    if host.lower() == "localhost":
        return "127.0.0.1"
    try:
        found = [ip_address(host)]
    except ValueError:
        try:
            answers = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError):
            return host
        found = [ip_address(answer[4][0]) for answer in answers]
    plain = [getattr(one, "ipv4_mapped", None) or one for one in found]
    best = min(plain, key=lambda one: (one.version, int(one)))
    return "127.0.0.1" if best.is_loopback or best.is_unspecified else str(best)
