"""Addresses of Zenoh, and what is opened for them."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Literal

import zenoh

from tci.errors import LinkError

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a robot is served unless the address says otherwise: this machine only."""
VALID = "valid: [NAME@]PROTOCOL/HOST:PORT, as in tcp/10.0.0.5:7447, or [NAME@]FILE.json5"
LEASE = 2000
"""Silence [ms] after which a connection counts as broken and is made anew. Ours."""


@dataclass(frozen=True, slots=True)
class Address:
    """An address of Zenoh, `[NAME@][WHERE]`."""

    robot: str
    """Name of the robot on the network: its keys begin with `tci/NAME/`."""
    where: str
    """An endpoint, or a configuration file of Zenoh."""

    @property
    def is_file(self) -> bool:
        """Whether `where` is a configuration file, which says all there is to say."""
        return self.where.endswith((".json5", ".json"))

    def __str__(self) -> str:
        return f"zenoh:{self.robot}@{self.where}"


def parse_address(text: str, robot: str) -> Address:
    """An address; `robot` is the name where it gives none. Raises LinkError."""
    name, at, where = text.rpartition("@")
    name, where = name if at else robot, where or ENDPOINT
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", name):
        raise LinkError(f"zenoh: the robot's name {name!r}; valid: letters, digits, _ and -")
    address = Address(name, where)
    if not address.is_file and not re.fullmatch(r"[a-z][a-z0-9_]*/[^\s/]\S*", where):
        raise LinkError(f"zenoh: address {where!r}; {VALID}")
    return address


def open_session(address: Address, does: Literal["listen", "connect"]) -> zenoh.Session:
    """A session of Zenoh. Without a file it talks to nobody but those at the endpoint.

    Raises LinkError for a file or an endpoint that can't be used, a port that is taken, and nobody there.
    """
    zenoh.init_log_from_env_or("off")
    try:
        if address.is_file:
            config = zenoh.Config.from_file(address.where)
        else:
            config = zenoh.Config.from_json5(json.dumps(_settings(address.where, does)))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise LinkError(f"{address}: {_brief(error)}; {VALID}") from error


def close_session(session: zenoh.Session) -> None:
    """Close what `open_session` gave. A second call does nothing."""
    if not session.is_closed():
        session.close()  # type: ignore[no-untyped-call] # Zenoh's own stub


def _settings(endpoint: str, does: Literal["listen", "connect"]) -> dict[str, object]:
    return {
        "mode": "peer" if does == "listen" else "client",
        does: {"endpoints": [endpoint], "retry": {"period_init_ms": 100, "period_max_ms": 1000}},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        # Shared memory gains nothing for messages of this size, and Zenoh 1.10 leaves a segment behind.
        "transport": {"link": {"tx": {"lease": LEASE}}, "shared_memory": {"enabled": False}},
    }


def _brief(error: zenoh.ZError) -> str:
    """What went wrong, without places in Zenoh's own source."""
    return re.sub(r"\s+at /\S+\.rs:\d+\.?", "", str(error)).strip().rstrip(".")
