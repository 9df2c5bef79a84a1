"""Addresses of Zenoh, and the sessions opened for them."""

from __future__ import annotations

import json
import re
from typing import Literal

import zenoh

from tci.drivers.remote.address import RemoteAddress, parse_remote
from tci.errors import DriverError
from yarpwire.connection_limit import PATIENCE

ENDPOINT = "tcp/127.0.0.1:7447"
"""Default endpoint at which a robot is served: this machine only."""
VALID = "valid: [NAME@]PROTOCOL/HOST:PORT, as in tcp/10.0.0.5:7447, or [NAME@]FILE.json5"
PENDING = 10_000
"""Unauthenticated connections that Zenoh lets wait before it refuses more: larger than `ConnectionMonitor`
allows."""
LEASE = 2000
"""Time [ms] without data after which a connection counts as broken and is opened again. Assumed: longer than
short network failures."""


def parse_address(text: str, robot: str) -> RemoteAddress:
    """Parses an address; `robot` is the name if it gives none. Raises DriverError."""
    address = parse_remote("zenoh", text, robot, ENDPOINT)
    if not is_file(address) and not re.fullmatch(r"[a-z][a-z0-9_]*/[^\s/]\S*", address.where):
        raise DriverError(f"zenoh: address {address.where!r}; {VALID}")
    return address


def is_file(address: RemoteAddress) -> bool:
    """Returns True if an address is a configuration file of Zenoh, which then contains all settings."""
    return address.where.endswith((".json5", ".json"))


def open_session(address: RemoteAddress, does: Literal["listen", "connect"]) -> zenoh.Session:
    """Opens a session of Zenoh. Without a file it connects only to the endpoint.

    Raises DriverError for a file or an endpoint that can't be used, a port that is in use, and when nothing
    answers.
    """
    zenoh.init_log_from_env_or("off")
    try:
        if is_file(address):
            config = zenoh.Config.from_file(address.where)
        else:
            config = zenoh.Config.from_json5(json.dumps(_settings(address.where, does)))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise DriverError(f"{address}: {_brief(error)}; {VALID}") from error


def close_session(session: zenoh.Session) -> None:
    """Closes what `open_session` returned. A second call does nothing."""
    if not session.is_closed():
        session.close()  # type: ignore[no-untyped-call] # Zenoh's own stub


def _settings(endpoint: str, does: Literal["listen", "connect"]) -> dict[str, object]:
    return {
        "mode": "peer" if does == "listen" else "client",
        does: {"endpoints": [endpoint], "retry": {"period_init_ms": 100, "period_max_ms": 1000}},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        # Shared memory gains nothing for messages of this size, and Zenoh 1.10 leaves a segment behind.
        "transport": {
            "unicast": {"accept_pending": PENDING, "accept_timeout": int(1e3 * PATIENCE)},
            "link": {"tx": {"lease": LEASE}},
            "shared_memory": {"enabled": False},
        },
    }


def _brief(error: zenoh.ZError) -> str:
    """Returns the text of the error, without places in Zenoh's own source."""
    return re.sub(r"\s+at /\S+\.rs:\d+\.?", "", str(error)).strip().rstrip(".")
