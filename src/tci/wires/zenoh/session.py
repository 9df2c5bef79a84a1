"""Parsing of addresses for Zenoh, and opening of sessions at these addresses."""

from __future__ import annotations

import json
import re
from typing import Literal

import zenoh

from tci.drivers.remote.address import RemoteAddress, parse_remote
from tci.errors import DriverError
from yarpwire.connection_limit import PATIENCE

ENDPOINT = "tcp/127.0.0.1:7447"
"""Default endpoint at which a robot is served. Only programs on this machine reach this endpoint."""
VALID = "valid: [NAME@]PROTOCOL/HOST:PORT, as in tcp/10.0.0.5:7447, or [NAME@]FILE.json5"
ADVICE = {
    "in use": "valid: a port that no other program uses",
    "Unable to connect": "valid: an address at which tci serve or a router of Zenoh listens",
}
"""Advice for errors of Zenoh that contain these words. Other errors are caused by the form of the address."""
PENDING = 10_000
"""Number of unauthenticated connections above which Zenoh refuses further connections. The number is so large
that TCI's own limit (`ConnectionMonitor`) applies first."""
LEASE = 2000
"""Time [ms] without data after which a connection counts as broken and is opened again. Assumed: short
network failures last less time."""


def parse_address(text: str, robot: str) -> RemoteAddress:
    """Parses an address. `robot` is the robot's name if the address has no name. Raises DriverError if the
    address is invalid."""
    address = parse_remote("zenoh", text, robot, ENDPOINT)
    if not is_file(address) and not re.fullmatch(r"[a-z][a-z0-9_]*/[^\s/]\S*", address.where):
        raise DriverError(f"zenoh: address {address.where!r}; {VALID}")
    return address


def is_file(address: RemoteAddress) -> bool:
    """Returns True if an address is a configuration file of Zenoh. The file then contains all settings."""
    return address.where.endswith((".json5", ".json"))


def open_session(address: RemoteAddress, does: Literal["listen", "connect"]) -> zenoh.Session:
    """Opens a session of Zenoh. If the address is no configuration file, the session uses only the
    endpoint in the address. Raises DriverError if the file or endpoint is invalid, if the port is in use, or
    if no process answers at the endpoint.
    """
    zenoh.init_log_from_env_or("off")
    try:
        if is_file(address):
            config = zenoh.Config.from_file(address.where)
        else:
            config = zenoh.Config.from_json5(json.dumps(_settings(address.where, does)))
        return zenoh.open(config)
    except zenoh.ZError as error:
        valid = next((advice for words, advice in ADVICE.items() if words in str(error)), VALID)
        raise DriverError(f"{address}: {_brief(error)}; {valid}") from error


def close_session(session: zenoh.Session) -> None:
    """Closes a session that `open_session` returned. A second call does nothing."""
    if not session.is_closed():
        session.close()  # type: ignore[no-untyped-call] # Zenoh's own stub


def _settings(endpoint: str, does: Literal["listen", "connect"]) -> dict[str, object]:
    return {
        "mode": "peer" if does == "listen" else "client",
        does: {"endpoints": [endpoint], "retry": {"period_init_ms": 100, "period_max_ms": 1000}},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        # Shared memory is off, since messages of this size do not become faster and Zenoh 1.10 does not
        # delete a shared-memory segment.
        "transport": {
            "unicast": {"accept_pending": PENDING, "accept_timeout": int(1e3 * PATIENCE)},
            "link": {"tx": {"lease": LEASE}},
            "shared_memory": {"enabled": False},
        },
    }


def _brief(error: zenoh.ZError) -> str:
    """Returns the text of an error, without file names and line numbers of Zenoh's source code."""
    return re.sub(r"\s+at /\S+\.rs:\d+\.?", "", str(error)).strip().rstrip(".")
