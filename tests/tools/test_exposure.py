"""The page on exposure lists the sockets that each server opens, as the operating system reports them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from helpers import ROOT
from tci.drivers.registry import server_names

TOOLS = ROOT / "tools" / "reliability"


@pytest.fixture
def exposure(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Returns the tool that lists sockets, as a module."""
    monkeypatch.syspath_prepend(str(TOOLS.parent))
    monkeypatch.syspath_prepend(str(TOOLS))
    yield importlib.import_module("exposure")
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__file__", "")).startswith(str(TOOLS)):
            del sys.modules[name]


def of_page(exposure: Any) -> list[str]:
    """Returns the rows of the table in the page, without the header."""
    report = importlib.import_module("report")
    table: str = report.between(exposure.PAGE, exposure.BEGIN, exposure.END)
    head: str = report.markdown(exposure.HEAD, [])
    assert table.startswith(head)
    return table.removeprefix(head).splitlines()


def test_the_page_has_every_server(exposure: Any) -> None:
    assert [*exposure.SERVERS] == [*server_names(), "view"]
    begins = [line.split("`")[1] for line in of_page(exposure)]
    assert begins == [*(f"tci serve --via {name}" for name in server_names()), "tci view"]


@pytest.mark.timeout(600)
def test_the_page_says_what_the_system_shows_and_nothing_is_open_to_a_network(exposure: Any) -> None:
    try:
        seen = exposure.seen()
    except OSError as error:
        pytest.skip(f"did not run: {error}")
    assert {"lcm", "player", "yarp", "zenoh"} <= seen.keys(), "what needs nothing but TCI's own extras"
    lines = of_page(exposure)
    for cells in exposure.table(seen):
        assert f"| {' | '.join(cells)} |" in lines
    assert [(name, one) for name, sockets in seen.items() for one in sockets if one.beyond] == []


@pytest.mark.parametrize(
    ("address", "interface", "beyond"),
    [
        ("127.0.0.1", "", False), ("::1", "", False), ("0.0.0.0", "lo", False),
        ("239.255.76.67", "lo", False),
        ("0.0.0.0", "", True), ("::", "", True), ("10.99.0.2", "", True), ("239.255.76.67", "", True),
        ("0.0.0.0", "eth0", True),
    ],
)  # fmt: skip
def test_a_socket_is_beyond_loopback_by_its_address_and_its_interface(
    exposure: Any, address: str, interface: str, beyond: bool
) -> None:
    assert exposure.Seen(address, 1, interface).beyond == beyond
