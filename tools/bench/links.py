"""Links: a frame of doubles to another process and back, over our YARP ports and over a raw TCP socket."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import threading
from time import perf_counter as wall

import numpy as np
from measured import ROUNDS, Measured, each, row

from tci.middleware.yarp.dialect import V3
from tci.middleware.yarp.incoming import Delivery
from tci.middleware.yarp.name_server import NameServer
from tci.middleware.yarp.names import Names
from tci.middleware.yarp.port import Port

SIZES = (768, 4000)
CALLS = 200
YARP = """
import sys
from tci.middleware.yarp.dialect import V3
from tci.middleware.yarp.names import Names
from tci.middleware.yarp.port import Port
names = Names((sys.argv[1], int(sys.argv[2])))
back = Port("/echo:o", names, V3)
there = Port("/echo:i", names, V3, receive=lambda delivery: back.write(delivery.vector(V3)))
back.connect("/bench:i")
print("ready", flush=True)
sys.stdin.read()
"""
TCP = """
import socket, sys
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


def links() -> list[Measured]:
    rows = []
    with NameServer() as server:
        names, came = Names(server.address), threading.Event()
        seen: list[np.ndarray] = []

        def receive(delivery: Delivery) -> None:
            seen[:] = [delivery.vector(V3)]
            came.set()

        here, out = Port("/bench:i", names, V3, receive=receive), Port("/bench:o", names, V3)
        echo = child(YARP, server.address[0], str(server.address[1]))
        assert line(echo) == "ready"
        out.connect("/echo:i")
        for size in SIZES:
            values = np.random.default_rng(0).normal(size=size)
            raw = child(TCP, str(values.nbytes))
            sock = socket.create_connection(("127.0.0.1", int(line(raw))))
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            back = np.empty(size)

            def ours(values: np.ndarray = values) -> None:
                came.clear()
                out.write(values)
                if not came.wait(5.0):
                    raise SystemExit("the frame did not come back")

            def peer(
                values: np.ndarray = values, sock: socket.socket = sock, back: np.ndarray = back
            ) -> None:
                sock.sendall(values)
                view, got = memoryview(back).cast("B"), 0
                while got < back.nbytes:
                    got += sock.recv_into(view[got:])

            ours()
            peer()
            np.testing.assert_array_equal(seen[0], values)
            np.testing.assert_array_equal(back, values)
            pairs = [
                (each(ours, calls=CALLS, clock=wall), each(peer, calls=CALLS, clock=wall))
                for _ in range(ROUNDS)
            ]
            note = f"{struct.calcsize('d') * size} bytes each way; two threads and the protocol are ours"
            rows.append(row(f"YARP port, {size} doubles, there and back", "raw TCP", pairs, note=note))
            sock.close()
            raw.communicate()
        for port in (out, here):
            port.close()
        echo.communicate()
    return rows
