"""Round-trip times of a frame of float64 values over YARP ports, Zenoh and LCM, compared with a raw TCP
socket.

A YARP port calls the receiver in the thread of the connection. The measured time ends at this call.
"""

from __future__ import annotations

import socket
import statistics
import struct
import subprocess
import sys
import threading
from time import perf_counter as wall

import numpy as np
from measured import ROUNDS, Measured, row
from round_trip import SIZE, in_turn

from yarpwire.carrier import FAST_TCP, TCP
from yarpwire.dialect import V3
from yarpwire.incoming import Delivery
from yarpwire.name_server import NameServer
from yarpwire.names import Names
from yarpwire.port import Port

CASES = ((768, TCP.name), (768, FAST_TCP.name), (4000, FAST_TCP.name))
CALLS = 200
MOST = 2.5
"""Largest accepted ratio of the time to that of the raw socket, for frames of 768 values."""
YARP = """
import sys, time
from yarpwire.dialect import V3
from yarpwire.names import Names
from yarpwire.port import Port
names = Names((sys.argv[1], int(sys.argv[2])))
back = Port("/echo:o", names, V3)
def echo(delivery):
    came = time.perf_counter()
    values = delivery.vector(V3).copy()
    values[-1] = came
    back.write(values)
there = Port("/echo:i", names, V3, receive=echo)
back.connect("/bench:i", sys.argv[3])
print("ready", flush=True)
sys.stdin.read()
"""
RAW = """
import socket, struct, sys, time
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
sock, _ = server.accept()
sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
size = int(sys.argv[1])
buffer = bytearray(size)
view = memoryview(buffer)
while True:
    got = 0
    while got < size:
        step = sock.recv_into(view[got:])
        if not step:
            sys.exit()
        got += step
    struct.pack_into("d", buffer, size - 8, time.perf_counter())
    sock.sendall(buffer)
"""


def child(program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


class Flight:
    """Frames that are sent to the other process and returned by it."""

    def __init__(self, names: Names, carrier: str, values: np.ndarray) -> None:
        self.values, self.seen = values, np.empty(0)
        self._times: list[float] = []
        self._ways: list[float] = []
        self._left, self._sent = 0, 0.0
        self._done = threading.Event()
        self._here, self._out = Port("/bench:i", names, V3, receive=self._come), Port("/bench:o", names, V3)
        self._echo = child(YARP, *map(str, names.address), carrier)
        assert line(self._echo) == "ready"
        self._out.connect("/echo:i", carrier)

    def fly(self) -> tuple[float, float]:
        """Returns the median time [us] of a round trip and the median time [us] to the other process. Both
        processes use the same clock."""
        self._times.clear()
        self._ways.clear()
        self._left = CALLS
        self._done.clear()
        self._go()
        if not self._done.wait(10.0):
            raise SystemExit("a frame was not returned by the other process")
        return 1e6 * statistics.median(self._times), 1e6 * statistics.median(self._ways)

    def close(self) -> None:
        self._out.close()
        self._here.close()
        self._echo.communicate()

    def _go(self) -> None:
        self._sent = wall()
        self._out.write(self.values)

    def _come(self, delivery: Delivery) -> None:
        self.seen = delivery.vector(V3)
        self._times.append(wall() - self._sent)
        self._ways.append(float(self.seen[-1]) - self._sent)
        self._left -= 1
        if self._left:
            self._go()
        else:
            self._done.set()


def wires() -> list[Measured]:
    rows = []
    with NameServer() as server:
        names = Names(server.address)
        for size, carrier in CASES:
            values = np.random.default_rng(0).normal(size=size)
            flight = Flight(names, carrier, values)
            raw = child(RAW, str(values.nbytes))
            sock = socket.create_connection(("127.0.0.1", int(line(raw))))
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            back = np.empty(size)

            def peer(
                values: np.ndarray = values, sock: socket.socket = sock, back: np.ndarray = back
            ) -> tuple[float, float]:
                trips, ways = [], []
                for _ in range(CALLS):
                    sent = wall()
                    sock.sendall(values)
                    view, got = memoryview(back).cast("B"), 0
                    while got < back.nbytes:
                        got += sock.recv_into(view[got:])
                    trips.append(wall() - sent)
                    ways.append(float(back[-1]) - sent)
                return 1e6 * statistics.median(trips), 1e6 * statistics.median(ways)

            flight.fly()
            peer()
            # The last number is the time at which the other process received the frame.
            np.testing.assert_array_equal(flight.seen[:-1], values[:-1])
            np.testing.assert_array_equal(back[:-1], values[:-1])
            both = [(flight.fly(), peer()) for _ in range(ROUNDS)]
            pairs = [(ours[0], theirs[0]) for ours, theirs in both]
            ways = [(ours[1], theirs[1]) for ours, theirs in both]
            note = f"{struct.calcsize('d') * size} bytes in each direction"
            most = MOST if size == CASES[0][0] else None
            name = f"YARP port by {carrier}, {size} doubles"
            rows.append(row(f"{name}, one way", "plain TCP socket", ways, note=note))
            rows.append(
                row(
                    f"{name}, round trip",
                    "plain TCP socket",
                    pairs,
                    most_ratio=most,
                    note=note,
                )
            )
            flight.close()
            sock.close()
            raw.communicate()
    return rows


def networks() -> list[Measured]:
    rows = []
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for name, where in (("zenoh", f"tcp/127.0.0.1:{port}"), ("lcm", f"udpm://239.255.76.67:{port}?ttl=0")):
        medians = (
            1e6 * np.median(times, axis=1) for times in in_turn(name, where, blocks=ROUNDS, calls=CALLS)
        )
        pairs = [(float(ours), float(theirs)) for ours, theirs in zip(*medians, strict=True)]
        note = f"{8 * SIZE} bytes in each direction; both processes poll, encode, check and decode"
        rows.append(row(f"{name}, {SIZE} doubles, round trip", "plain TCP socket", pairs, note=note))
    return rows
