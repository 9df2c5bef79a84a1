"""Messages of hostile programs end at most the connection on which they arrive: neither the process nor the
motion of the robot."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import tci
from helpers.hostile_bottles import strange_messages
from helpers.yarp_show import until
from tci.drivers.simulated import SimulatedDriver
from tci.wires.yarp.served_board import ServedBoard
from tci.wires.yarp.server import YarpServer
from yarpwire import message, outgoing
from yarpwire.bottle import encode_bottle
from yarpwire.carrier import TCP, TEXT
from yarpwire.dialect import DIALECTS, V3, V4
from yarpwire.errors import CallError, PortError
from yarpwire.incoming import Delivery
from yarpwire.name_server import NameServer
from yarpwire.names import Names, parse_contact
from yarpwire.port import Port
from yarpwire.rpc import Rpc
from yarpwire.text import from_text, to_text
from yarpwire.values import Vocab

INFINITE, NO_NUMBER = float("inf"), float("nan")


@pytest.fixture
def names() -> Iterator[Names]:
    with NameServer() as server:
        yield Names(server.address)


@pytest.fixture(autouse=True)
def failed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[object]]:
    """Yields the exceptions that ended a thread. For such an exception the loop would stop the robot."""
    found: list[object] = []
    monkeypatch.setattr(threading, "excepthook", lambda told: found.append(told.exc_value))
    yield found
    assert found == []


@pytest.fixture(params=list(DIALECTS))
def shown(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[YarpServer]:
    """Yields a server of an unarmed robot on YARP without a control loop."""
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    driver = SimulatedDriver(tci.load_robot("nao"), arm=False)
    with YarpServer(driver, f"127.0.0.1:0,dialect={request.param}") as server:
        yield server


def test_streamed_commands_to_no_joint_are_refused_and_told(shown: YarpServer) -> None:
    writer = outgoing.Outgoing(shown.network.query("/nao/LArm/command:i"), "/stranger", TCP)
    head = [Vocab("ipod")] if shown.dialect is V4 else []
    for count, joint in enumerate(("abc", INFINITE, NO_NUMBER, 0.5, [0], 1 << 40, b"\xff"), 1):
        assert writer.offer([[*head, Vocab("dpo"), joint], [1.0]], shown.dialect)
        assert until(lambda count=count: shown.refused == count)
        assert "valid: 0 to 5" in shown.last_error
    writer.close()


def test_calls_about_no_joint_are_answered(shown: YarpServer) -> None:
    read, switch, unread, unset = {
        V3: ("get enc", "set icmd cmod", "[fail]", "[fail]"),
        V4: ("getEncoderOneRPC", "setControlModeOneRPC", "([err5]) 0.0", "[err5]"),
    }[shown.dialect]
    there = shown.network.query("/nao/LArm/rpc:i" if shown.dialect is V3 else "/nao/LArm/nws/rpc:i")
    sock, source, _ = outgoing.dial(there, "x", TEXT, None)
    for call, failure in ((f"{read} inf", unread), (f"{read} nan", unread), (f"{switch} 0 {1 << 40}", unset)):
        sock.sendall(f"d\r\n{call}\r\n".encode())
        assert source.line() == failure
    sock.close()
    rpc = Rpc(there, "/stranger", shown.dialect)
    for item in (INFINITE, NO_NUMBER, "\udcff", [1]):
        call = [Vocab("get"), Vocab("enc"), item] if shown.dialect is V3 else ["getEncoderOneRPC", item]
        assert to_text(rpc.call(*call)) == unread
    rpc.close()


@pytest.mark.parametrize(
    ("numbers", "words"),
    [(["abc"], [0]), ([INFINITE], [0]), ([NO_NUMBER], [0]), (0, [0]), ("0", [0]), ([0], [1 << 40]),
     ([0], [INFINITE]), ([0], [NO_NUMBER]), ([0], ["setposit"]), ([0], [[]]), ([0], 0), ([0], "p")],
)  # fmt: skip
def test_a_board_says_what_joints_and_modes_it_has(numbers: object, words: object) -> None:
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    for act in (board.set_modes, board.set_interactions):
        with pytest.raises(CallError, match="valid"):
            act(numbers, words)


@pytest.mark.parametrize("target", [b"tcp:/\xff", b"/\xff", b"tcp://a\nNAME_SERVER unregister /r"])
def test_orders_with_a_name_that_is_none_are_answered(names: Names, target: bytes) -> None:
    port = Port("/r", names, V3)
    sock, source, _ = outgoing.dial(port.contact, "/stranger", TCP, None)
    body = encode_bottle([Vocab("add"), target.decode(errors="surrogateescape")], V3)
    sock.sendall(message.pack_message([message.pack_command(message.ADMIN), body]))
    assert source.take(8)[4:] == b"\2\0\0\0", "an answer, of two items"
    assert names.query("/r") == port.contact
    sock.close()
    port.close()


def test_a_host_that_is_none_can_not_be_reached(names: Names) -> None:
    names.request("register", "/odd", "tcp", "a..b", "4000")
    port = Port("/r", names, V3)
    with pytest.raises(PortError, match="can't be reached"):
        port.connect("/odd")
    port.close()


def test_a_name_server_that_says_no_port_says_nothing(names: Names) -> None:
    for port in ("70000", "0000011234567", "1" * 5000, "\N{ARABIC-INDIC DIGIT ONE}", "0"):
        assert parse_contact(f"registration name /a ip 127.0.0.1 port {port} type tcp") is None


def test_what_nobody_foresaw_ends_its_connection_and_is_counted_and_told(names: Names) -> None:
    def receive(delivery: Delivery) -> None:
        raise ZeroDivisionError("nobody foresaw it")

    port = Port("/r", names, V3, receive=receive)
    sock, source, _ = outgoing.dial(port.contact, "/stranger", TCP, None)
    sock.sendall(message.pack_message([message.pack_command(message.DATA), encode_bottle([1], V3)]))
    with pytest.raises(EOFError):
        source.take(1)
    assert until(lambda: port.dropped == 1)
    assert port.wrong == 1
    assert port.last_error == "/stranger: ZeroDivisionError: nobody foresaw it"
    assert outgoing.order(port.contact, from_text("[ver]"), None) == "[ver] 1 2 3"
    sock.close()
    port.close()


def test_strange_values_are_answered_or_refused_and_nothing_else(names: Names) -> None:
    port = Port("/r", names, V3)
    take, chance = strange_messages(port), random.Random(20261122)
    for _ in range(8000):
        take(chance)
    port.close()
