"""Servers bound their number of connections, so that silent clients do not exclude others."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from xmlrpc.client import ServerProxy

import psutil
import pytest
import viser
import zenoh
from websockets.sync.client import connect as open_websocket

import tci
from helpers import HELPERS, TESTS
from helpers.ros_robots import anywhere, roscore
from helpers.served import needs_qi
from helpers.wire_peers import free_port
from tci.drivers.simulated import SimulatedDriver
from tci.lab.viewer.guard import close_server, open_server
from tci.shared.own_sockets import ConnectionMonitor, listening
from tci.wires.player.client import Client
from tci.wires.player.server import PlayerServer
from tci.wires.zenoh.session import close_session, open_session, parse_address
from yarpwire.connection_limit import MOST, PATIENCE, AcceptedConnection, ConnectionLimit, surplus
from yarpwire.dialect import V3
from yarpwire.name_server import NameServer
from yarpwire.names import END, Names
from yarpwire.port import Port

pytestmark = pytest.mark.timeout(180)
Again = Callable[[], object]
"""Function that repeats a request over an open connection. Raises an error when the connection is closed."""
Ask = Callable[[], Again]
"""Function that connects as a genuine client does."""


@contextmanager
def yarp_names() -> Iterator[tuple[int, Ask]]:
    with NameServer() as server:
        yield server.address[1], lambda: _lines(server.address[1], b"", b"NAME_SERVER list\n", END.encode())


@contextmanager
def yarp_port() -> Iterator[tuple[int, Ask]]:
    with NameServer() as server:
        port = Port("/port", Names(server.address), V3)
        number = port.contact.port
        yield number, lambda: _lines(number, b"CONNECT a\r\n", b"*\r\n", b"connections")
        port.close()


def _lines(port: int, greeting: bytes, question: bytes, end: bytes) -> Again:
    sock = socket.create_connection(("127.0.0.1", port), timeout=20)
    sock.sendall(greeting)

    def again() -> None:
        sock.sendall(question)
        said = b""
        while end not in said:
            more = sock.recv(1 << 16)
            assert more, "it was closed"
            said += more

    again()
    return again


@contextmanager
def player() -> Iterator[tuple[int, Ask]]:
    ended = threading.Event()
    with SimulatedDriver(tci.load_robot("nao")) as driver, PlayerServer(driver, ":0") as server:

        def loop() -> None:
            while not ended.wait(0.01):
                server.fault()

        thread = threading.Thread(target=loop)
        thread.start()
        yield server.port, lambda: Client("127.0.0.1", server.port).devices
        ended.set()
        thread.join()


@contextmanager
def viewer() -> Iterator[tuple[int, Ask]]:
    server, _, address = open_server("127.0.0.1", 0, label="test")
    port = int(address.rsplit(":", 1)[1])

    def ask() -> Again:
        page = open_websocket(
            f"ws://127.0.0.1:{port}", origin=f"http://127.0.0.1:{port}",
            subprotocols=[f"viser-v{viser.__version__}"],
        )  # fmt: skip

        def again() -> None:
            assert page.ping().wait(20)

        again()
        return again

    yield port, ask
    close_server(server)


@contextmanager
def naoqi() -> Iterator[tuple[int, Ask]]:
    needs_qi()
    port = free_port()

    def ask() -> Again:
        import qi

        session = qi.Session()
        session.connect(f"tcp://127.0.0.1:{port}", _async=True).value(20_000)
        motion = session.service("ALMotion")
        return lambda: (session, motion.getAngles("Body", True))

    with _process(f"naoqi:127.0.0.1:{port}"):
        yield port, ask


@contextmanager
def over_zenoh() -> Iterator[tuple[int, Ask]]:
    port = free_port()
    where = f"tcp/127.0.0.1:{port}"

    def ask() -> Again:
        session = open_session(parse_address(where, "nao"), "connect")

        def again() -> zenoh.Session:
            assert [one for one in session.get("tci/nao/facts", timeout=20.0) if one.ok]
            return session

        again()
        stack.callback(close_session, session)
        return again

    with _process(f"zenoh:{where}"), ExitStack() as stack:
        yield port, ask


@contextmanager
def ros1() -> Iterator[tuple[int, Ask]]:
    master, space = ServerProxy(roscore()), anywhere()
    topic = f"{space}/joint_states"

    def port() -> int:
        ((_, (node, *_)),) = [one for one in master.getSystemState("/test")[2][0] if one[0] == topic]
        with ServerProxy(master.lookupNode("/test", node)[2]) as asked:
            return int(asked.requestTopic("/test", topic, [["TCPROS"]])[2][2])

    def ask() -> Again:
        sock = socket.create_connection(("127.0.0.1", port()), timeout=20)
        fields = [f"{name}={value}".encode() for name, value in
                  {"callerid": anywhere(), "topic": topic, "md5sum": "*", "type": "*"}.items()]  # fmt: skip
        header = b"".join(struct.pack("<I", len(one)) + one for one in fields)
        sock.sendall(struct.pack("<I", len(header)) + header)

        def again() -> None:
            assert sock.recv(1 << 16)

        again()
        return again

    with _process(f"ros1:{space}"):
        yield port(), ask


@contextmanager
def _process(via: str) -> Iterator[None]:
    command = [sys.executable, str(HELPERS / "patient.py"), via]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=TESTS)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.communicate()


SERVERS = {
    "yarp-names": yarp_names, "yarp-port": yarp_port, "player": player, "viewer": viewer, "naoqi": naoqi,
    "zenoh": over_zenoh, "ros1": ros1,
}  # fmt: skip
SILENT = ("zenoh", "ros1")
"""Middlewares whose clients may be silent for any time."""


@pytest.mark.parametrize("name", SERVERS)
def test_strangers_who_say_nothing_keep_no_newcomer_out_and_are_let_go(name: str) -> None:
    with SERVERS[name]() as (port, ask), ExitStack() as stack:
        first = ask()
        first()
        strangers = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=20))
            for _ in range(3 * MOST // 2)
        ]
        begun = time.monotonic()
        newcomer = ask()
        newcomer()
        first()
        assert time.monotonic() - begun < 10.0
        for stranger in strangers:
            with suppress(ConnectionError):  # the connection was closed during a message
                while stranger.recv(1 << 16):  # a server may send a greeting before any request
                    continue
        first()
        newcomer()


@pytest.mark.parametrize("name", [name for name in SERVERS if name not in SILENT])
def test_clients_who_asked_once_and_are_idle_keep_no_newcomer_out(name: str) -> None:
    with SERVERS[name]() as (port, ask):
        idle = [ask() for _ in range(MOST)]
        # the first client has sent another message, and the second client was silent for the longest time
        idle[0]()
        newcomer = ask()
        newcomer()
        idle[0]()
        end = time.monotonic() + 20.0
        while _held(port) > MOST and time.monotonic() < end:
            time.sleep(0.1)  # the server of a library may exceed the bound until the next check
        assert _held(port) <= MOST


def _held(port: int) -> int:
    return sum(
        one.laddr.port == port and one.status == "ESTABLISHED" for one in psutil.net_connections("tcp")
    )


def test_strangers_go_first_then_who_was_silent_the_longest() -> None:
    gone: list[str] = []
    now = 0.0
    limit = ConnectionLimit(3, clock=lambda: now)

    def add(name: str) -> AcceptedConnection:
        return limit.add(lambda: gone.append(name))

    old, young = add("old"), add("young")
    old.mark_verified(0.1)
    young.mark_verified(0.2)
    now = 1.0
    add("stranger")
    add("another")
    assert gone == ["stranger"]
    old.mark_verified(1.1)
    now = 1.0 + PATIENCE + 0.1
    limit.trim()
    assert gone == ["stranger", "another"], "they have only so long"
    for number in range(2):
        add(f"third {number}").mark_verified(now)
    assert gone == ["stranger", "another", "young"]
    assert (len(limit), limit.ended) == (3, 3)
    limit.remove(old)
    limit.remove(old)
    limit.end_all()
    assert len(limit) == 0
    assert sorted(gone[3:]) == ["third 0", "third 1"]


def test_whoever_spoke_may_be_silent_for_as_long_as_there_is_room() -> None:
    known = [AcceptedConnection(lambda: None, 0.0, verified=True) for _ in range(3)]
    assert surplus(known, 1e9, 3) == []


def test_a_librarys_connections_are_told_apart_by_what_came() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as stack:
        port = server.getsockname()[1]
        monitor = ConnectionMonitor(port, most=2)
        monitor.close()
        near, far = [], []
        for number in range(4):
            near.append(stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=20)))
            far.append(stack.enter_context(server.accept()[0]))
            if number < 3:
                near[-1].sendall(b"hello")
            time.sleep(0.02)
        near[0].sendall(b"again")
        monitor.check()
        assert monitor.ended == 2
        for number in (1, 3):  # the unknown client, and the connection that was silent for the longest time
            assert near[number].recv(1) == b""
        for number in (0, 2):
            far[number].sendall(b"there")
            assert near[number].recv(5) == b"there"


def test_a_look_at_a_socket_leaves_it_as_it_was() -> None:
    """If a default timeout is set, as by rospy, a Python socket object would make the inspected socket
    non-blocking."""
    before = socket.getdefaulttimeout()  # an earlier test with rospy may have set a timeout
    try:
        socket.setdefaulttimeout(None)
        with socket.create_server(("127.0.0.1", 0)) as server:
            socket.setdefaulttimeout(20.0)
            assert server.getsockname()[1] in listening()
            assert os.get_blocking(server.fileno())
    finally:
        socket.setdefaulttimeout(before)
