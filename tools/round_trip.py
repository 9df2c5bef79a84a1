"""Times the round trip of a frame of 768 float64 values to another process over each middleware, alternately
with a raw TCP socket. `make middleware` and `make bench` use this module."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import zenoh
from numpy.typing import NDArray

import tci
from tci.drivers.remote import encoding as remote_cdr
from tci.drivers.remote.address import parse_remote
from tci.drivers.remote.protocol import SessionFrame
from tci.messages import SkinFrame
from tci.shared.interface_node import InterfaceNode, latest
from tci.shared.ros1_node import Ros1Node
from tci.shared.ros2_node import open_node
from tci.shared.ros_node import RosNode
from tci.wires.lcm import encoding as remote_lcm
from tci.wires.lcm.driver import _Bus
from tci.wires.player.wire import OPAQUE, STATE, Message, MessageKind, Stream, blob, to_blob
from tci.wires.ros.messages import BYTES, NO_LAYOUT
from tci.wires.ros.rosbridge import RosbridgeNode
from tci.wires.unitree.messages import HAND_STATE
from tci.wires.unitree.wire import MOTOR_STATE, PRESS, encode_hand
from tci.wires.zenoh.driver import QOS
from tci.wires.zenoh.session import close_session, open_session, parse_address
from yarpwire.dialect import DIALECTS
from yarpwire.errors import PortError
from yarpwire.names import Names
from yarpwire.port import Port

TCP = """
import socket, sys
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
sock, _ = server.accept()
sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
while data := sock.recv(1 << 16):
    sock.sendall(data)
"""
SIZE, BLOCKS, CALLS = 768, 10, 40
PATIENCE = 20.0
"""Longest time [s] until the first frame returns. Assumed: discovery takes some seconds at most."""
Ways = tuple[Callable[[bytes], object], Callable[[], Iterator[bytes]], Callable[[], None]]
"""Functions that send a frame, yield the frames that have arrived, and close the connection."""


def over_zenoh(where: str, there: bool) -> Ways:
    """Exchanges bytes under two keys, with the quality of service that TCI's Zenoh driver uses."""
    session = open_session(parse_address(where, "nao"), "listen" if there else "connect")
    out = session.declare_publisher("tci/bench/back" if there else "tci/bench/there", **QOS)
    key = "tci/bench/there" if there else "tci/bench/back"
    came = session.declare_subscriber(key, zenoh.handlers.RingChannel(1))

    def receive() -> Iterator[bytes]:
        sample = came.try_recv()
        if sample is not None:
            yield sample.payload.to_bytes()

    return out.put, receive, lambda: close_session(session)


def over_lcm(where: str, there: bool) -> Ways:
    """Exchanges bytes on two channels of a multicast group."""
    bus = _Bus(parse_remote("lcm", where, "bench", ""))
    wanted = "there" if there else "back"

    def receive() -> Iterator[bytes]:
        yield from (data for name, data, _ in bus.poll() if name == wanted)

    return lambda data: bus.put("back" if there else "there", data), receive, bus.close


def over_ros(node: RosNode, there: bool) -> Ways:
    """Exchanges bytes on two topics, like two processes of TCI."""
    came: list[bytes] = []
    names = ("/bench_back", "/bench_there") if there else ("/bench_there", "/bench_back")
    out = node.advertise(names[0], BYTES)
    node.subscribe(names[1], BYTES, lambda fields: came.append(bytes(fields["data"])))

    def receive() -> Iterator[bytes]:
        node.poll()
        while came:
            yield came.pop(0)

    return lambda data: out((NO_LAYOUT, np.frombuffer(data, dtype=np.uint8))), receive, node.close


def over_rosbridge(where: str, there: bool) -> Ways:
    return over_ros(RosbridgeNode("127.0.0.1", int(where)), there)


def over_player(where: str, there: bool) -> Ways:
    """Exchanges opaque messages over one connection, like a driver and a server of TCI."""
    address = ("127.0.0.1", int(where))
    sock = socket.create_server(address).accept()[0] if there else _dial(address)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream = Stream()
    kind = MessageKind.DATA if there else MessageKind.COMMAND

    def receive() -> Iterator[bytes]:
        sock.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            for message in stream.feed(sock.recv(1 << 16)):
                yield to_blob(message.body)

    def send(data: bytes) -> None:
        sock.setblocking(True)
        sock.sendall(Message(OPAQUE, 0, kind, STATE, 0.0, blob(data)).to_bytes())

    return send, receive, sock.close


def over_naoqi(where: str, there: bool) -> Ways:
    """Calls a service with a list of numbers, which is how NAOqi transports numbers."""
    import qi

    session, came = qi.Session(), []
    if there:
        session.listenStandalone(f"tcp://127.0.0.1:{where}")
        session.registerService("Echo", _Echo())
        return lambda data: None, lambda: iter(()), session.close
    end = time.monotonic() + PATIENCE
    while not session.isConnected():
        with contextlib.suppress(RuntimeError):
            session.connect(f"tcp://127.0.0.1:{where}")
        assert time.monotonic() < end
    echo = session.service("Echo")

    def send(data: bytes) -> None:
        came.append(np.array(echo.back(np.frombuffer(data).tolist())).tobytes())

    def receive() -> Iterator[bytes]:
        while came:
            yield came.pop(0)

    return send, receive, session.close


class _Echo:
    def back(self, values: list[float]) -> list[float]:
        return values


def over_unitree(where: str, there: bool) -> Ways:
    """Exchanges bytes in the message for the motors of a hand, the only message of Unitree without a fixed
    length."""
    node, count = InterfaceNode("lo", int(where)), -(-8 * SIZE // MOTOR_STATE.itemsize)
    ways = ("rt/bench/back", "rt/bench/there")
    out, into = ways if there else ways[::-1]
    send, came = node.out(out, HAND_STATE), node.reader(into, HAND_STATE)

    def receive() -> Iterator[bytes]:
        yield from (sample.raw[8 : 8 + 8 * SIZE] for sample in latest(came))

    def put(data: bytes) -> None:
        motors = np.frombuffer(data.ljust(count * MOTOR_STATE.itemsize), MOTOR_STATE)
        send(encode_hand(motors, np.zeros(0, PRESS)))

    return put, receive, node.close


def over_yarp(where: str, there: bool) -> Ways:
    """Exchanges vectors over two ports, with the names and dialect of `tci serve --via yarp`."""
    address, _, dialect = where.partition(",")
    spoken = DIALECTS[dialect]
    host, _, port = address.partition(":")
    names, came = Names((host, int(port))), []
    side, other = ("there", "here") if there else ("here", "there")
    into = Port(
        f"/bench/{side}:i", names, spoken, receive=lambda found: came.append(found.vector(spoken).tobytes())
    )
    out = Port(f"/bench/{side}:o", names, spoken)
    end = time.monotonic() + PATIENCE
    while True:
        try:
            out.connect(f"/bench/{other}:i")
            break
        except PortError:
            assert time.monotonic() < end
            time.sleep(0.1)

    def receive() -> Iterator[bytes]:
        while came:
            yield came.pop(0)

    def close() -> None:
        out.close()
        into.close()

    return lambda data: out.write(np.frombuffer(data)), receive, close


OVER: dict[str, Callable[[str, bool], Ways]] = {
    "zenoh": over_zenoh,
    "lcm": over_lcm,
    "naoqi": over_naoqi,
    "yarp": over_yarp,
    "yarp4": over_yarp,
    "ros2": lambda where, there: over_ros(open_node(f"bench_{'there' if there else 'here'}", ""), there),
    "ros1": lambda where, there: over_ros(Ros1Node("bench"), there),
    "player": over_player,
    "rosbridge": over_rosbridge,
    "unitree": over_unitree,
}
PLAIN = ("naoqi", "unitree", "yarp", "yarp4")
"""Middleware that transports plain numbers. The others transport skin frames with a header and a checksum."""


def _dial(address: tuple[str, int]) -> socket.socket:
    end = time.monotonic() + PATIENCE
    while True:
        with contextlib.suppress(ConnectionRefusedError):
            return socket.create_connection(address)
        assert time.monotonic() < end
        time.sleep(0.05)


def _open(name: str, where: str) -> Ways:
    """Opens the connection of this process as soon as the other process is ready."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return OVER[name](where, False)
        except tci.TciError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def echo(name: str, where: str) -> None:
    """Runs the other process, which sends each received frame back."""
    robot, codec = tci.load_robot("nao"), remote_lcm if name == "lcm" else remote_cdr
    send, receive, _ = OVER[name](where, True)
    while True:
        for data in receive():
            send(data if name in PLAIN else codec.frame_bytes(robot, codec.to_skin(robot, data)))
        time.sleep(0)


def in_turn(
    name: str, where: str, *, blocks: int = BLOCKS, calls: int = CALLS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the times (blocks, calls) [s] of round trips over the middleware and, alternately, over raw
    TCP."""
    robot, codec = tci.load_robot("nao"), remote_lcm if name == "lcm" else remote_cdr
    values = np.random.default_rng(0).normal(size=SIZE)
    frame = SessionFrame(1, SkinFrame(robot.patches[0].name, 1.0, 1, values))
    other = subprocess.Popen([sys.executable, __file__, name, where])
    raw = subprocess.Popen([sys.executable, "-c", TCP, str(values.nbytes)], stdout=subprocess.PIPE, text=True)
    assert raw.stdout is not None
    sock = socket.create_connection(("127.0.0.1", int(raw.stdout.readline())))
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    send, receive, close = _open(name, where)
    back = bytearray(values.nbytes)

    def bare() -> None:
        sock.sendall(values)
        view, got = memoryview(back), 0
        while got < len(back):
            got += sock.recv_into(view[got:])

    def there_and_back(patience: float = 5.0) -> bool:
        send(values.tobytes() if name in PLAIN else codec.frame_bytes(robot, frame))
        end = time.perf_counter() + patience
        while time.perf_counter() < end:
            for data in receive():
                back = np.frombuffer(data) if name in PLAIN else codec.to_skin(robot, data).frame.values
                assert np.array_equal(back, values)
                return True
            time.sleep(0)
        return False

    try:
        end = time.monotonic() + PATIENCE
        while not there_and_back(0.5):
            if time.monotonic() > end:
                raise SystemExit(f"{name}: no frame was returned by the other process")
        time.sleep(0.5)
        list(receive())  # answers to earlier tries
        found = [[_times(work, calls) for work in (there_and_back, bare)] for _ in range(blocks)]
    finally:
        close()
        sock.close()
        for process in (other, raw):
            process.kill()
            process.communicate()
    ours, theirs = np.array(found).transpose(1, 0, 2)
    return ours, theirs


def _times(work: Callable[[], object], calls: int) -> list[float]:
    times = []
    for _ in range(calls):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return times


if __name__ == "__main__":
    echo(*sys.argv[1:])
