"""A unique name per host, for limits that count by host."""

from __future__ import annotations

import socket
from ipaddress import ip_address


def numeric(host: str) -> str:
    """Returns the numeric address of a host, which is equal for all its names; 127.0.0.1 for every loopback
    address.

    If a host has several addresses, the lowest one is returned, preferably of IPv4. A name that can't be
    resolved is returned unchanged. The call waits for the network only if `host` is a name. `localhost` is
    never looked up: not every machine has it in /etc/hosts.
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
