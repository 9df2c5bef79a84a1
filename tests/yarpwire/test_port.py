"""Ports, carriers and calls, tested over real sockets."""

from __future__ import annotations

import os
import queue
import resource
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from yarpwire import message, outgoing
from yarpwire.carrier import CARRIERS, FAST_TCP, TCP, TEXT, TEXT_ACK
from yarpwire.connection_limit import AcceptedConnection
from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import PortError, UnknownNameError
from yarpwire.incoming import Delivery
from yarpwire.listener import Listener
from yarpwire.message import Stamp
from yarpwire.name_server import NameServer
from yarpwire.names import Contact, Names
from yarpwire.outgoing import Outgoing
from yarpwire.port import Port
from yarpwire.rpc import Rpc
from yarpwire.values import Vocab


@pytest.fixture
def names() -> Iterator[Names]:
    with NameServer() as server:
        yield Names(server.address)


@pytest.fixture
def make(names: Names) -> Iterator[Callable[..., Port]]:
    ports: list[Port] = []

    def open_port(name: str, dialect: Dialect = V3, **options: object) -> Port:
        ports.append(Port(name, names, dialect, **options))
        return ports[-1]

    yield open_port
    for port in ports:
        port.close()


def until(condition: Callable[[], bool], *, within: float = 5.0) -> bool:
    end = time.monotonic() + within
    while not condition() and time.monotonic() < end:
        time.sleep(0.002)
    return condition()


@pytest.mark.parametrize("carrier", CARRIERS)
@pytest.mark.parametrize("dialect", [V3, V4])
def test_every_carrier_brings_vectors_and_their_stamps(
    carrier: str, dialect: Dialect, make: Callable[..., Port]
) -> None:
    came: queue.Queue[Delivery] = queue.Queue()
    reader = make("/r", dialect, receive=came.put)
    writer = make("/w", dialect)
    writer.connect("/r", carrier)
    assert until(lambda: reader.inputs == ("/w",))
    values = np.linspace(0.0, 255.0, 768)
    for count in range(3):
        writer.write(values + count, Stamp(count, 1795218732.78965 + count))
        delivery = came.get(timeout=5)
        np.testing.assert_array_equal(delivery.vector(dialect), values + count)
        assert delivery.stamp == Stamp(count, 1795218732.78965 + count)
        assert delivery.sender == "/w"
    writer.write([Vocab("state"[:4]), 1, "two words", [3.5, [4]]])
    assert came.get(timeout=5).items(dialect) == [Vocab("stat"), 1, "two words", [3.5, [4]]]
    assert reader.wrong == 0


def test_a_port_is_told_to_send_and_to_stop(make: Callable[..., Port], names: Names) -> None:
    came: queue.Queue[Delivery] = queue.Queue()
    writer, reader = make("/w"), make("/r", receive=came.put)
    reader.listen_to("/w", "tcp")
    assert writer.outputs == ("/r",)
    said = outgoing.order(writer.contact, [Vocab("list"), Vocab("out"), "/r"], None)
    assert said == "(from /w) (to /r) (carrier tcp)".replace("/w", '"/w"').replace("/r", '"/r"')
    writer.write(np.ones(3))
    assert came.get(timeout=5).vector(V3).tolist() == [1.0, 1.0, 1.0]
    assert outgoing.order(writer.contact, [Vocab("del"), "/r"], None).startswith("0 ")
    assert writer.outputs == ()
    names.register(Contact("/gone", "127.0.0.1", 9))
    assert outgoing.order(writer.contact, [Vocab("add"), "tcp://gone"], None).startswith("-1 ")
    with pytest.raises(UnknownNameError, match="/w"):
        reader.listen_to("/nobody")


@pytest.mark.parametrize("carrier", [TCP, FAST_TCP, TEXT, TEXT_ACK])
@pytest.mark.parametrize("dialect", [V3, V4])
def test_calls_are_answered(carrier: object, dialect: Dialect, make: Callable[..., Port]) -> None:
    port = make("/rpc", dialect, receive=lambda delivery: [Vocab("is"), *delivery.items(dialect)])
    rpc = Rpc(port.contact, "/client", dialect, carrier=carrier)
    for value in (2.5, 7, "word", [1.0, 2.0]):
        assert rpc.call(Vocab("get"), value) == [Vocab("is"), Vocab("get"), value]
    rpc.close()


def test_no_reply_is_an_empty_one_and_silence_a_time_out(make: Callable[..., Port]) -> None:
    quiet = make("/quiet", receive=lambda delivery: None)
    assert Rpc(quiet.contact, "/client", V3).call(Vocab("get")) == []
    stop = threading.Event()

    def slow(delivery: Delivery) -> None:
        stop.wait(5)

    rpc = Rpc(make("/slow", receive=slow).contact, "/client", V3)
    with pytest.raises(PortError, match="does not answer"):
        rpc.call(Vocab("get"), patience=0.1)
    stop.set()


def test_a_call_goes_on_after_the_port_came_back(make: Callable[..., Port], names: Names) -> None:
    port = make("/rpc", receive=lambda delivery: [1])
    rpc = Rpc(port.contact, "/client", V3)
    assert rpc.call(0) == [1]
    port.close()
    with pytest.raises(PortError):
        rpc.call(0)
    rpc.contact = make("/rpc", receive=lambda delivery: [2]).contact
    assert rpc.call(0) == [2]


def test_a_listener_that_is_closed_leaves_no_thread() -> None:
    """A thread that does not end keeps its objects in memory. Their library would report a memory leak at the
    end of the program."""
    served, left = threading.Event(), threading.Event()

    def serve(sock: socket.socket, connection: AcceptedConnection) -> None:
        served.set()
        sock.recv(1)
        left.wait(0.02)  # simulates a switch to another thread at this point
        left.set()

    listener = Listener("127.0.0.1", 0, serve, name="a port")
    with socket.create_connection(listener.address):
        assert served.wait(5.0)
        listener.close()
        assert left.is_set()
    assert not [thread for thread in threading.enumerate() if thread.name.endswith("a port")]


def test_a_reply_is_awaited_in_a_process_with_more_than_1024_open_files(make: Callable[..., Port]) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    go = threading.Event()
    port = make("/rpc", receive=lambda delivery: [int(go.wait(10))])
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
        while (number := os.dup(0)) <= 1024:
            stack.callback(os.close, number)
        stack.callback(os.close, number)
        rpc = Rpc(port.contact, "/client", V3)
        stack.callback(rpc.close)
        rpc.send_call(0)
        assert not rpc.is_answered(0.05)
        go.set()
        assert rpc.is_answered(10.0)
        assert rpc.read_reply(10.0) == [1]


def test_a_second_connection_of_a_sender_ends_the_first(make: Callable[..., Port]) -> None:
    came: queue.Queue[Delivery] = queue.Queue()
    reader = make("/r", receive=came.put)
    first = Outgoing(reader.contact, "/w", TCP)
    second = Outgoing(reader.contact, "/w", TCP)
    second.offer(np.ones(1), V3)
    assert came.get(timeout=5).sender == "/w"

    def lost() -> bool:
        try:
            return not first.offer(np.ones(1), V3)
        except PortError:
            return True

    assert until(lost)
    assert reader.inputs == ("/w",)


def test_30_part_of_a_message_is_waited_for_not_long(make: Callable[..., Port]) -> None:
    reader = make("/r", receive=lambda delivery: None)
    sock, _, _ = outgoing.dial(reader.contact, "/partial", FAST_TCP, None)
    sock.sendall(message.number(10) + b"\2\1")
    sock.settimeout(10)
    assert sock.recv(1) == b""
    assert reader.inputs == ()


@pytest.mark.parametrize("length", [-1, 2**31 - 1])
def test_31_hostile_lengths_end_the_connection(length: int, make: Callable[..., Port]) -> None:
    reader = make("/r", receive=lambda delivery: None)
    sock, _, _ = outgoing.dial(reader.contact, "/hostile", FAST_TCP, None)
    sock.sendall(message.number(10) + b"\2\1" + b"\xff" * 8 + struct.pack("<iii", length, length, 0))
    sock.settimeout(5)
    assert sock.recv(1) == b""
    assert until(lambda: reader.wrong == 1)
    assert "valid" in reader.last_error


def test_32_a_reader_that_does_not_read_costs_the_writer_nothing(make: Callable[..., Port]) -> None:
    writer = make("/w")
    make("/good", receive=lambda delivery: None)
    with socket.create_server(("127.0.0.1", 0)) as server:
        writer.names.register(Contact("/stuck", *server.getsockname()[:2]))
        threading.Thread(target=lambda: writer.connect("/stuck"), daemon=True).start()
        sock, _ = server.accept()
        sock.recv(100)
        sock.sendall(message.number(1))
        assert until(lambda: writer.outputs == ("/stuck",))
        writer.connect("/good", "fast_tcp")
        longest = 0.0
        for _ in range(3000):
            begun = time.perf_counter()
            writer.write(np.zeros(768))
            longest = max(longest, time.perf_counter() - begun)
        assert writer.dropped > 1000
        assert longest < 1.0
        sock.close()


def test_33_a_flood_is_read_at_a_bounded_rate(make: Callable[..., Port]) -> None:
    count = [0]

    def receive(delivery: Delivery) -> None:
        count[0] += 1

    reader = make("/r", receive=receive)
    sock, _, _ = outgoing.dial(reader.contact, "/flood", FAST_TCP, None)
    one = message.pack_message([message.pack_command(message.DATA), struct.pack("<ii", 256, 0)])
    sock.settimeout(0.2)
    end = time.monotonic() + 0.5
    try:
        while time.monotonic() < end:
            sock.sendall(one * 500)
    except TimeoutError:
        pass
    sock.close()
    assert 0 < count[0] < 20_000


def test_more_connections_than_allowed_are_refused(make: Callable[..., Port]) -> None:
    reader = make("/r", receive=lambda delivery: None)
    socks = [socket.create_connection((reader.contact.host, reader.contact.port), 2) for _ in range(80)]
    assert until(lambda: reader.dropped >= 16)
    for sock in socks:
        sock.close()
    assert until(lambda: _answers(reader))


def _answers(port: Port) -> bool:
    try:
        return outgoing.order(port.contact, [Vocab("ver")], None) == "[ver] 1 2 3"
    except PortError:
        return False


def test_keys_must_be_the_same() -> None:
    with NameServer(key=b"secret") as server:
        names = Names(server.address, key=b"secret")
        port = Port("/rpc", names, V3, receive=lambda delivery: [1])
        assert Rpc(port.contact, "/client", V3, key=b"secret").call(0) == [1]
        with pytest.raises(PortError, match=r"auth\.conf"):
            Rpc(port.contact, "/client", V3, key=b"wrong").call(0)
        with pytest.raises(PortError):
            Rpc(port.contact, "/client", V3).call(0)
        other = Port("/w", names, V4)
        other.connect("/rpc", "udp")
        port.close()
        other.close()


def test_what_the_receiver_raises_ends_the_connection_only(make: Callable[..., Port]) -> None:
    def receive(delivery: Delivery) -> list[int]:
        return [int(sum(delivery.vector(V3)))]

    port = make("/r", receive=receive)
    rpc = Rpc(port.contact, "/client", V3)
    with pytest.raises(PortError):
        rpc.call("no numbers")
    assert port.wrong == 1
    assert _answers(port)


def test_what_a_person_types_first_is_answered(make: Callable[..., Port], names: Names) -> None:
    """Tests the orders of `yarp admin rpc PORT` and `yarp name help`."""
    port = make("/asked", receive=lambda delivery: None)

    def order(*items: object) -> str:
        return outgoing.order(port.contact, [Vocab(str(items[0])), *items[1:]], None)

    assert order("ver") == "[ver] 1 2 3"
    listed = order("help")
    assert listed.startswith("[many]")
    assert all(f"[{verb}]" in listed for verb in ("help", "ver", "add", "del", "list", "prop"))
    assert order("abc") == '[fail] "send [help] for list of valid commands"'
    assert order("prop", Vocab("get"), "/asked") == "(port ((is_input true) (is_output true) (is_rpc false)))"
    assert "cannot find" in order("prop", Vocab("get"), "/elsewhere")
    assert order("prop", Vocab("get"), "colour") == ""
    said = names.request("help")
    assert any("query" in line for line in said)
    assert any("register" in line for line in said)
