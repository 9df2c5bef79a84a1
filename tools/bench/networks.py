"""Round trips of a frame of doubles over Zenoh and LCM, beside a raw TCP socket."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import zenoh
from measured import ROUNDS, Measured, each, row
from wires import RAW, child, line

import tci
from tci.drivers.lcm import encoding as remote_lcm
from tci.drivers.lcm.driver import _Bus
from tci.drivers.remote import encoding as remote_cdr
from tci.drivers.remote.address import parse_remote
from tci.drivers.remote.protocol import SessionFrame
from tci.drivers.zenoh.driver import QOS
from tci.drivers.zenoh.session import close_session, open_session, parse_address
from tci.messages import SkinFrame

SIZE, CALLS = 768, 200
ECHO = """
import sys
sys.path[:0] = sys.argv[3:]
from networks import echo
echo(sys.argv[1], sys.argv[2])
"""
Ways = tuple[Callable[[bytes], None], Callable[[], Iterator[bytes]], Callable[[], None]]
"""Functions that send a frame, yield the frames that have come, and close the connection."""


def over_zenoh(where: str, there: bool) -> Ways:
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
    bus = _Bus(parse_remote("lcm", where, "bench", ""))
    wanted = "there" if there else "back"

    def receive() -> Iterator[bytes]:
        yield from (data for name, data, _ in bus.poll() if name == wanted)

    return lambda data: bus.put("back" if there else "there", data), receive, bus.close


OVER = {"zenoh": over_zenoh, "lcm": over_lcm}


def echo(name: str, where: str) -> None:
    """Runs the other process, which reads each frame and writes it back."""
    robot, codec = tci.load_robot("nao"), remote_cdr if name == "zenoh" else remote_lcm
    send, receive, _ = OVER[name](where, True)
    print("ready", flush=True)
    while True:
        for data in receive():
            send(codec.frame_bytes(robot, codec.to_skin(robot, data)))
        time.sleep(0)


def there_and_back(
    codec: Any, robot: tci.Robot, frame: SessionFrame, send: Any, receive: Any
) -> SessionFrame:
    """Sends a frame and returns it as it comes back."""
    send(codec.frame_bytes(robot, frame))
    end = time.perf_counter() + 2.0
    while time.perf_counter() < end:
        for data in receive():
            return codec.to_skin(robot, data)
    raise SystemExit("the frame did not come back")


def networks() -> list[Measured]:
    robot = tci.load_robot("nao")
    values = np.random.default_rng(0).normal(size=SIZE)
    frame = SessionFrame(1, SkinFrame(robot.patches[0].name, 1.0, 1, values))
    raw = child(RAW, str(values.nbytes))
    sock = socket.create_connection(("127.0.0.1", int(line(raw))))
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    back = bytearray(values.nbytes)

    def peer() -> None:
        sock.sendall(values)
        view, got = memoryview(back), 0
        while got < len(back):
            got += sock.recv_into(view[got:])

    rows = []
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for name, where in (("zenoh", f"tcp/127.0.0.1:{port}"), ("lcm", f"udpm://239.255.76.67:{port}?ttl=0")):
        codec = remote_cdr if name == "zenoh" else remote_lcm
        other = child(ECHO, name, where, *sys.path)
        assert line(other) == "ready"
        send, receive, close = OVER[name](where, False)
        time.sleep(0.5)  # until both know of each other
        ours = partial(there_and_back, codec, robot, frame, send, receive)
        np.testing.assert_array_equal(ours().frame.values, values)
        peer()
        wall = partial(each, calls=CALLS, clock=time.perf_counter)
        pairs = [(wall(ours), wall(peer)) for _ in range(ROUNDS)]
        note = f"{values.nbytes} bytes each way; both ends poll, encode, check and decode"
        rows.append(row(f"{name}, {SIZE} doubles, there and back", "raw TCP", pairs, note=note))
        close()
        other.kill()
        other.communicate()
    sock.close()
    raw.communicate()
    return rows
