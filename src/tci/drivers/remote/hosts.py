"""One name per host, for what counts by host."""

from __future__ import annotations

import socket
from ipaddress import ip_address


def numeric(host: str) -> str:
    """The address of a host, whichever of its names it is given; 127.0.0.1 for every loopback address.

    Of several addresses it is the lowest one, of IPv4 where there is one. A name that can't be resolved stays
    as it is. It waits for the network only where `host` is a name. `localhost` is known without asking: not
    every machine has it in /etc/hosts.
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
