"""Connections over udp. Only a quit message ends such a connection, because a genuine sender closes the TCP
connection of its handshake immediately."""

from __future__ import annotations

import queue
import socket
import struct
import threading
import zlib
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from helpers.yarp_show import until
from yarpwire import message, outgoing
from yarpwire.bottle import encode_bottle
from yarpwire.carrier import UDP
from yarpwire.connection_limit import MOST
from yarpwire.dialect import V3
from yarpwire.incoming import Delivery, Incoming
from yarpwire.name_server import NameServer
from yarpwire.names import Names
from yarpwire.port import Port
from yarpwire.values import Vocab


class Reader:
    """A port, and the messages that it received."""

    def __init__(self, names: Names) -> None:
        self.came: queue.Queue[Delivery] = queue.Queue()
        self.port = Port("/r", names, V3, receive=self.came.put)

    def dial(self, sender: str) -> Callable[[bytes], object]:
        """Returns a function that sends bytes like YARP's own sender, after the handshake over TCP has
        ended."""
        sock, _, port = outgoing.dial(self.port.contact, sender, UDP, None)
        sock.close()
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        datagrams.connect((self.port.contact.host, port))
        return datagrams.send


def datagram(*items: object) -> bytes:
    body = message.pack_message([message.pack_command(message.DATA), encode_bottle(items, V3)])
    return struct.pack("<Ii", zlib.crc32(body), 0) + body


@pytest.fixture
def names() -> Iterator[Names]:
    with NameServer() as server:
        yield Names(server.address)


@pytest.fixture
def reader(names: Names) -> Iterator[Reader]:
    found = Reader(names)
    yield found
    found.port.close()


def test_a_silent_sender_stays_and_an_empty_datagram_ends_nothing(reader: Reader) -> None:
    send = reader.dial("/quiet")
    for empty in (b"", b"\0" * 7, b"\0" * 10):  # YARP sends the last of these to interrupt itself
        send(empty)
    send(datagram("there"))
    assert reader.came.get(timeout=40).items(V3) == ["there"]
    assert reader.port.inputs == ("/quiet",)


def test_who_closes_says_goodbye_beside_the_datagrams(reader: Reader, names: Names) -> None:
    writer = Port("/w", names, V3)
    writer.connect("/r", "udp")
    writer.write(np.ones(2))
    assert reader.came.get(timeout=40).vector(V3).tolist() == [1.0, 1.0]
    assert outgoing.order(writer.contact, [Vocab("del"), "/r"], None).startswith("0 ")
    assert reader.port.inputs == ()
    writer.connect("/r", "udp")
    assert until(lambda: reader.port.inputs == ("/w",))
    writer.close()
    assert reader.port.inputs == ()


def test_a_second_connection_is_not_ended_by_the_goodbye_of_the_first(reader: Reader, names: Names) -> None:
    writer = Port("/w", names, V3)
    for count in range(3):
        writer.connect("/r", "udp")
        writer.write([count])
        assert reader.came.get(timeout=40).items(V3) == [count]
        assert reader.port.inputs == ("/w",)
    writer.close()


def test_a_reader_that_is_gone_is_not_told_goodbye(
    reader: Reader, names: Names, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = Port("/w", names, V3)
    writer.connect("/r", "udp")
    reader.port.close()
    # otherwise the loop that writes would wait for the connection
    monkeypatch.setattr(outgoing, "dial", None)

    def gone() -> bool:
        writer.write([1])
        return writer.outputs == ()

    assert until(gone)
    writer.close()


@pytest.mark.parametrize("name", ["/dead", "dead"])
def test_of_a_full_port_the_sender_goes_that_was_silent_the_longest(reader: Reader, name: str) -> None:
    quiet, busy = reader.dial("/quiet"), reader.dial("/busy")
    for number in range(MOST - 2):
        reader.dial(f"{name}/{number}")
    for send in (quiet, busy):
        send(datagram("there"))
        reader.came.get(timeout=40)
    for _ in range(8):
        assert outgoing.order(reader.port.contact, [Vocab("ver")], None) == "[ver] 1 2 3"
        reader.dial("late")
    assert "silent" in reader.port.last_error
    for send in (quiet, busy):
        send(datagram("there"))
        assert reader.came.get(timeout=40).items(V3) == ["there"]


def test_a_port_that_closes_lets_every_sender_go(names: Names) -> None:
    before = set(threading.enumerate())
    reader = Reader(names)
    for sender in ("/named", "unnamed"):
        reader.dial(sender)(datagram(sender))
        assert reader.came.get(timeout=40).sender == sender
    mine = {thread for thread in set(threading.enumerate()) - before if thread.name.endswith(" /r")}
    assert len(mine) >= 3, "one accepts, two serve"
    reader.port.close()
    for thread in mine:
        thread.join(40)
    assert not [thread.name for thread in mine if thread.is_alive()]


def test_a_sender_that_greets_while_its_port_closes_is_let_go(
    names: Names, monkeypatch: pytest.MonkeyPatch
) -> None:
    greet, closed = Incoming.greet, threading.Event()

    def late(incoming: Incoming, key: bytes | None, add: Callable[[str], None]) -> None:
        greet(incoming, key, add)
        serving.append(threading.current_thread())
        closed.wait(40)

    serving: list[threading.Thread] = []
    monkeypatch.setattr(Incoming, "greet", late)
    reader = Reader(names)
    reader.dial("unnamed")
    assert until(lambda: bool(serving))
    reader.port.close()
    closed.set()
    serving[0].join(40)
    assert not serving[0].is_alive()


def test_a_silent_port_looks_now_and_then_whether_it_was_closed(
    reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A port checks at intervals if it has been closed. If a wake-up is lost, the thread then ends some
    seconds later."""
    ended, run = threading.Event(), Incoming.run

    def watched(incoming: Incoming) -> None:
        run(incoming)
        ended.set()

    monkeypatch.setattr(Incoming, "run", watched)
    monkeypatch.setattr(Incoming, "close", lambda incoming: setattr(incoming, "_closed", True))
    reader.dial("unnamed")
    reader.port.close()
    assert ended.wait(40)
