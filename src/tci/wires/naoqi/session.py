"""Sessions with NAOqi: addresses, credentials, and readable errors."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import qi

from tci.errors import DriverError

PORT = 9559
"""Port of NAOqi up to 2.8, and of TCI's own server."""
SECURE_PORT = 9503
"""Port of NAOqi 2.9, which uses credentials and encryption."""
PASSWORD = "TCI_NAOQI_PASSWORD"
"""Environment variable with the password. Other users could read a password on the command line."""
TIMEOUT = 3.0
"""Longest time [s] for connecting, and for each answer while connecting. Assumed: a robot on the local
network answers within a second."""
VALID = "valid: naoqi://HOST[:PORT], or naoqi://USER@HOST for NAOqi 2.9"

# The library logs to standard output, which other programs may parse.
qi.logging.setLevel(qi.logging.SILENT)


@dataclass(frozen=True, slots=True)
class Address:
    """Address of the NAOqi of one robot."""

    host: str
    port: int
    user: str = ""
    """User name for the login. The text is empty for NAOqi up to 2.8, which has no login."""
    life: str = "refuse"
    """Action of an armed driver if autonomous motions are on. "refuse": it refuses to connect. "off": it
    switches these motions off."""

    @property
    def url(self) -> str:
        """Address in the form that `qi` expects."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tcps' if self.user else 'tcp'}://{host}:{self.port}"


def parse_address(text: str) -> Address:
    """Parses the part of an address after `naoqi:`, such as `//10.0.0.5`, `10.0.0.5:9559` or
    `//nao@10.0.0.5`.

    Raises DriverError if the address is invalid.
    """
    parts = urlsplit(text if text.startswith("//") else f"//{text}")
    try:
        host, port, user = parts.hostname or "", parts.port, parts.username or ""
    except ValueError as error:
        raise DriverError(f"address {text!r}: {error}; {VALID}") from error
    if parts.password is not None:
        raise DriverError(f"a password on a command line is visible to other users; valid: set ${PASSWORD}")
    if not host or parts.path not in ("", "/") or parts.fragment:
        raise DriverError(f"address {text!r}; {VALID}")
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    if options.pop("life", "refuse") not in ("refuse", "off") or options:
        raise DriverError(f"address {text!r}: ?{parts.query}; valid: ?life=refuse, ?life=off")
    life = "off" if "life=off" in parts.query else "refuse"
    return Address(host, port if port is not None else SECURE_PORT if user else PORT, user, life)


class _Login:
    """User name and password for `qi`, which requires two objects: an authenticator, and a factory that makes
    the authenticator. This object is both."""

    def __init__(self, user: str, password: str) -> None:
        self._words = {"user": user, "token": password}

    def newAuthenticator(self) -> _Login:
        return self

    def initialAuthData(self) -> dict[str, str]:
        return self._words


def open_session(address: Address, *, timeout: float = TIMEOUT) -> Any:
    """Opens a `qi.Session`. Raises DriverError if the session is not open within `timeout` [s]."""
    session = qi.Session()
    if address.user:
        password = os.environ.get(PASSWORD)
        if password is None:
            raise DriverError(f"the password of {address.user!r} is missing; valid: set ${PASSWORD}")
        session.setClientAuthenticatorFactory(_Login(address.user, password))
    try:
        session.connect(address.url, _async=True).value(int(1e3 * timeout))
    except RuntimeError as error:
        raise DriverError(
            f"no NAOqi at {address.url}: {first_line(error)}; {_advice(address, error)}"
        ) from None
    return session


def service(session: Any, name: str) -> Any:
    """Returns a service by name. Waits for the service, since a robot that was just switched on is still
    starting.

    Raises DriverError if the service is not available within 3 s.
    """
    until = time.monotonic() + TIMEOUT
    while True:
        left = max(0.1, until - time.monotonic())
        try:
            session.waitForService(name, _async=True).value(int(1e3 * left))
            return session.service(name, _async=True).value(int(1e3 * left))
        except RuntimeError as error:
            # A service that was registered just now may not answer the first calls.
            if time.monotonic() < until and session.isConnected():
                time.sleep(0.05)
                continue
            raise DriverError(
                f"NAOqi has no service {name} ({first_line(error)}); the robot may still be starting"
            ) from None


class Services:
    """The services of one session."""

    def __init__(self, address: Address, *, motion: bool) -> None:
        """Opens a session and the session's services, but ALMotion only if `motion` is True. Raises
        DriverError if a service is missing."""
        self.session = open_session(address)
        try:
            self.motion: Any = service(self.session, "ALMotion") if motion else None
            self.memory = service(self.session, "ALMemory")
        except DriverError:
            self.close()
            raise

    def close(self) -> None:
        """Ends the session."""
        with suppress(RuntimeError):
            self.session.close()


def answer(future: Any, what: str, *, timeout: float) -> Any:
    """Returns the result of a call. Raises DriverError if the call fails, or takes longer than `timeout`
    [s]."""
    try:
        return future.value(int(1e3 * timeout))
    except RuntimeError as error:
        raise DriverError(f"NAOqi, {what}: {first_line(error)}") from None


def first_line(error: Exception) -> str:
    """Returns the first line of an error of `qi`, without the traceback that follows."""
    return (str(error).strip().splitlines() or ["no reason given"])[0][:200].rstrip(".:")


def _advice(address: Address, error: Exception) -> str:
    text = str(error)
    if "refused" in text:
        return f"check that the robot is on and that {address.port} is its port; {VALID}"
    if "not found" in text:
        return f"check the name of the host; {VALID}"
    if address.user:
        return f"check the user name and ${PASSWORD}"
    return f"a robot with NAOqi 2.9 requires credentials: naoqi://USER@{address.host}"
