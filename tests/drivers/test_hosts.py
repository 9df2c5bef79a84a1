"""Different spellings of a host are recognised as the same host."""

from __future__ import annotations

import socket

import pytest

import tci
from helpers.player_exchange import RecordedServer
from helpers.rosbridge_exchange import narrow
from tci.drivers.lease import lease
from tci.drivers.remote.hosts import numeric
from tci.errors import DriverError


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "localhost", "LOCALHOST", "::1", "127.0.1.1", "0.0.0.0", "::ffff:127.0.0.1"]
)
def test_names_of_the_loopback_are_one(host: str) -> None:
    assert numeric(host) == "127.0.0.1"


def test_a_name_is_the_address_behind_it_in_whichever_order_they_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    book = {"nao.local": ["fe80::1%eth0", "10.0.0.6", "10.0.0.5"], "six.local": ["2001:DB8::1"]}

    def resolve(host: str, *_: object, **__: object) -> list[tuple[object, ...]]:
        if host not in book:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return [(0, 0, 0, "", (address, 0)) for address in book[host]]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    assert numeric("nao.local") == numeric("10.0.0.5") == "10.0.0.5"
    book["nao.local"].reverse()
    assert numeric("nao.local") == "10.0.0.5"
    assert numeric("six.local") == numeric("2001:db8:0::1") == "2001:db8::1"
    assert numeric("nobody.local") == "nobody.local"


def test_a_numeric_address_and_localhost_ask_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: pytest.fail("it asked"))
    assert numeric("10.0.0.5") == "10.0.0.5"
    assert numeric("localhost") == numeric("LocalHost") == "127.0.0.1"


def test_26_a_host_by_two_names_has_one_commander() -> None:
    names = []
    for host in ("127.0.0.1", "127.1"):  # on some machines `localhost` has no address
        server = RecordedServer()  # accepts only one client
        try:
            with tci.connect(narrow(), f"player:{host}:{server.port}") as driver:
                names.append(driver.info.lease_name.replace(str(server.port), "6665"))
        finally:
            server.close()
    with lease(names[0]), pytest.raises(DriverError, match="one commander at a time"), lease(names[1]):
        pytest.fail("two have it")
