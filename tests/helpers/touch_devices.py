"""Stand-ins for tactile devices, made from what their makers publish, with faults that a test switches on.
They import nothing of TCI."""

from __future__ import annotations

import json
import logging
import os
import secrets
import socket
import struct
import subprocess
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any, ClassVar

from helpers import HELPERS
from helpers.dds_domains import DOMAINS, LOOPBACK


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class TouchDevice(ABC):
    """A device whose pads a test sets. All faults are off at first."""

    pads: ClassVar[dict[str, int]]
    """Number of values of each pad."""
    alone = False
    """True if it serves one client at a time."""
    second = True
    """False if a second client is refused at once."""
    most = 4095
    """Largest value of a taxel."""
    needs = ""
    """Module without which it can't be played."""

    def __init__(self) -> None:
        self.values: dict[str, list[int]] = {pad: [0] * size for pad, size in self.pads.items()}
        self.received: list[bytes] = []
        """Everything that was sent to the device, message by message."""
        self.delay = 0.0
        """Time [s] by which the next answer or line is late, once."""
        self.lose = 0
        """Number of answers or lines that get lost."""
        self.short = False
        """Frames lack a value."""
        self.port = free_port()
        self._in: threading.Event = threading.Event()
        self._threads: list[threading.Thread] = []

    @property
    @abstractmethod
    def via(self) -> str:
        """Address of the device for TCI."""

    @abstractmethod
    def serve(self) -> None:
        """Serves until `_in` is cleared."""

    def meet(self, source: Any) -> None:  # noqa: B027 - devices are found by their address
        """Gets the source that is going to read it."""

    def may_be_sent(self, request: bytes) -> bool:
        """Whether the device allows this, as far as its state is what matters: nothing may change it."""
        return False

    def plug(self) -> None:
        self._in.set()
        thread = threading.Thread(target=self.serve, daemon=True)
        thread.start()
        self._threads.append(thread)

    def pull(self) -> None:
        """Unplugs it without waiting until it is gone."""
        self._in.clear()

    def unplug(self) -> None:
        self.pull()
        for thread in self._threads:
            thread.join(timeout=5.0)
        self._threads.clear()

    def number(self) -> None:
        """Gives each taxel of the device another value."""
        k = 0
        for pad, size in self.pads.items():
            self.values[pad] = [(7 * (k + i)) % (self.most + 1) for i in range(size)]
            k += size

    def late(self) -> None:
        delay, self.delay = self.delay, 0.0
        time.sleep(delay)


INSPIRE = {
    f"{finger}_{pad}": (3000 + 370 * i + offset, size)
    for i, finger in enumerate(("little", "ring", "middle", "index"))
    for pad, offset, size in (("tip", 0, 9), ("top", 18, 96), ("pad", 210, 80))
} | {"thumb_tip": (4480, 9), "thumb_top": (4498, 96), "thumb_middle": (4690, 9), "thumb_pad": (4708, 96),
     "palm": (4900, 112)}  # fmt: skip
"""Byte address and size of each pad (Inspire, manual PRJ-02-TS-U-001)."""


class InspireHand(TouchDevice):
    """Modbus TCP as the hand speaks it: addresses count bytes, words are big endian, and the transaction id
    of an answer is one too high. One client at a time."""

    pads: ClassVar = {pad: size for pad, (_, size) in INSPIRE.items()}
    alone = True
    breath = 0.0
    """Time [s] that each answer takes."""

    def __init__(self) -> None:
        super().__init__()
        self.angles: Callable[[], list[int]] = lambda: [1000, 900, 800, 700, 600, 500]
        """Measured angles when they are asked for."""

    @property
    def via(self) -> str:
        return f"inspire:127.0.0.1:{self.port}"

    def serve(self) -> None:
        with socket.create_server(("127.0.0.1", self.port)) as door:
            door.settimeout(0.05)
            while self._in.is_set():
                with suppress(TimeoutError, OSError):
                    link, _ = door.accept()
                    with link:
                        link.settimeout(0.05)
                        self._talk(link)

    def _talk(self, link: socket.socket) -> None:
        while self._in.is_set():
            try:
                request = link.recv(260)
            except TimeoutError:
                continue
            if not request:
                return
            self.received.append(request)
            number, _, _, unit, function = struct.unpack_from(">HHHBB", request)
            address, count = struct.unpack_from(">HH", request, 8)
            if function == 3:
                data = self._memory()[address : address + 2 * count - 2 * self.short]
                body = bytes([unit, 3, len(data)]) + data
            else:
                body = request[6:12]
            self.delay = self.delay or self.breath
            self.late()
            if self.lose:
                self.lose -= 1
            else:
                link.sendall(struct.pack(">HHH", (number + 1) & 0xFFFF, 0, len(body)) + body)

    def may_be_sent(self, request: bytes) -> bool:
        if len(request) != 12:
            return False
        _, _, _, _, function, address, count = struct.unpack(">HHHBBHH", request)
        return function == 3 and (address, count) in {*INSPIRE.values(), (1546, 6)}

    def _memory(self) -> bytes:
        memory = bytearray(6000)
        for pad, (address, size) in INSPIRE.items():
            struct.pack_into(f">{size}H", memory, address, *self.values[pad])
        struct.pack_into(">6H", memory, 1546, *self.angles())
        return bytes(memory)


class Lines(TouchDevice):
    """Sends each pad as a line of text, 50 times a second."""

    pads: ClassVar = {"fingertip": 12, "palm": 5}
    period = 0.02

    def lines(self) -> list[str]:
        return [f"{pad} {','.join(map(str, values[self.short :]))}\n" for pad, values in self.values.items()]


class UdpLines(Lines):
    """One datagram for each line."""

    second = False  # its port is taken

    @property
    def via(self) -> str:
        return f"array:udp://127.0.0.1:{self.port}"

    def serve(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while self._in.is_set():
                self.late()
                for line in self.lines():
                    if self.lose:
                        self.lose -= 1
                    else:
                        out.sendto(line.encode(), ("127.0.0.1", self.port))
                time.sleep(self.period)


class TcpLines(Lines):
    """A server that sends the lines to everybody who connects; lines are cut anywhere."""

    @property
    def via(self) -> str:
        return f"array:tcp://127.0.0.1:{self.port}"

    def serve(self) -> None:
        links: list[socket.socket] = []
        with socket.create_server(("127.0.0.1", self.port)) as door:
            door.setblocking(False)
            while self._in.is_set():
                with suppress(BlockingIOError):
                    links.append(door.accept()[0])
                self.late()
                text = "".join(self.lines()).encode()
                for link in links:
                    link.setblocking(False)
                    with suppress(BlockingIOError, OSError):
                        if heard := link.recv(1000):
                            self.received.append(heard)
                    if not self.lose:
                        with suppress(OSError):
                            link.sendall(text[:30])
                            link.sendall(text[30:])
                self.lose -= self.lose > 0
                time.sleep(self.period)
        for link in links:
            link.close()


class Program(Lines):
    """The program that runs the robot, and knows the values itself."""

    via = "array:feed"

    def __init__(self) -> None:
        super().__init__()
        self._sources: list[Any] = []

    def meet(self, source: Any) -> None:
        self._sources.append(source)

    def serve(self) -> None:
        while self._in.is_set():
            self.late()
            for pad, values in self.values.items():
                if self.lose:
                    self.lose -= 1
                    continue
                for source in self._sources:
                    source.feed(pad, values[self.short :])
            time.sleep(self.period)


class Publisher(TouchDevice):
    """Another process that publishes what it reads on its standard input, and prints a line once it can."""

    @abstractmethod
    def words(self) -> list[str]:
        """The command."""

    def line(self) -> str:
        return ";".join(" ".join(map(str, values[self.short :])) for values in self.values.values())

    def plug(self) -> None:
        self._ready = threading.Event()
        super().plug()
        assert self._ready.wait(30.0)

    def serve(self) -> None:
        own, pipe = os.environ | {"CYCLONEDDS_URI": LOOPBACK}, subprocess.PIPE
        node = subprocess.Popen(self.words(), env=own, stdin=pipe, stdout=pipe, text=True)
        assert node.stdin is not None
        assert node.stdout is not None
        if node.stdout.readline():
            self._ready.set()
        while self._in.is_set():
            self.late()
            if self.lose:
                self.lose -= 1
            else:
                print(self.line(), file=node.stdin, flush=True)
            time.sleep(0.02)
        node.kill()
        node.wait()


class Ros2Topic(Publisher):
    """A node that publishes numbers on a topic of ROS 2."""

    pads: ClassVar = {"pad": 16}
    needs = "cyclonedds"

    def __init__(self) -> None:
        super().__init__()
        self._domain, self._topic = next(DOMAINS), f"/n{secrets.token_hex(4)}"
        os.environ |= {"ROS_DOMAIN_ID": str(self._domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

    @property
    def via(self) -> str:
        return f"array:ros2://{self._topic}"

    def words(self) -> list[str]:
        return [sys.executable, str(HELPERS / "ros2_one_topic.py"), self._topic, str(self._domain)]


class Ros1Topic(Publisher):
    """A node that publishes numbers on a topic of ROS 1."""

    pads: ClassVar = {"pad": 16}

    def __init__(self) -> None:
        super().__init__()
        self._topic = f"/n{secrets.token_hex(4)}"

    @property
    def via(self) -> str:
        return f"array:ros1://{self._topic}"

    def plug(self) -> None:
        from helpers.ros_robots import roscore  # not where a peer's Python plays a hand

        roscore()
        super().plug()

    def words(self) -> list[str]:
        return ["/usr/bin/python3", str(HELPERS / "ros1_one_topic.py"), self._topic]


class InspireBridge(Publisher):
    """The left hand's topic of the maker's bridge on Unitree's robots."""

    pads: ClassVar = InspireHand.pads
    needs = "cyclonedds"

    def __init__(self) -> None:
        super().__init__()
        self._domain = next(DOMAINS)

    @property
    def via(self) -> str:
        return f"inspire:dds://lo/{self._domain},side=left"

    def words(self) -> list[str]:
        return [sys.executable, str(HELPERS / "inspire_bridge.py"), str(self._domain), "l", "given"]


class Linkerhand(TouchDevice):
    """The right hand on a virtual bus of python-can: a message for each row, whose second byte has the row
    (LinkerHand, linkerhand-ros2-sdk bba0b9d5)."""

    needs = "can"
    pads: ClassVar = {f"{one}_tip": 72 for one in ("thumb", "index", "middle", "ring", "little")}
    options, code, columns = ",hand=L6", 0xC6, 6
    angles = (250, 200, 150, 100, 50, 0)
    most = 255

    @property
    def via(self) -> str:
        return f"linkerhand:bus-{self.port},side=right,interface=virtual{self.options}"

    def plug(self) -> None:
        import can  # before the thread, as that takes a while

        self._can = can
        super().plug()

    def serve(self) -> None:
        can = self._can
        with can.Bus(f"bus-{self.port}", interface="virtual") as bus:
            while self._in.is_set():
                request = bus.recv(0.02)
                if request is None:
                    continue
                self.received.append(bytes((request.arbitration_id,)) + request.data)
                if request.arbitration_id == 0x27 and request.data == b"\1":
                    data = bytes((1, *self.angles))
                    bus.send(can.Message(arbitration_id=0x27, data=data, is_extended_id=False))
                if request.arbitration_id != 0x27 or request.data[1:] != bytes((self.code,)):
                    continue  # its client of another author also asks for angles
                pad = [*self.pads][request.data[0] - 0xB1]
                self.late()
                for row, at in enumerate(range(0, self.pads[pad], self.columns)):
                    if self.lose:
                        self.lose -= 1
                        continue
                    data = bytes(self.values[pad][at + self.short : at + self.columns])
                    head = bytes((request.data[0], row << 4))
                    bus.send(can.Message(arbitration_id=0x27, data=head + data, is_extended_id=False))

    def may_be_sent(self, request: bytes) -> bool:
        touch = 0xB1 <= request[1] <= 0xB5 and request[2:] == bytes((self.code,))
        return request[0] == 0x27 and (touch or request[1:] == b"\1")


class LinkerhandO6(Linkerhand):
    """The hand with smaller matrices."""

    pads: ClassVar = dict.fromkeys(Linkerhand.pads, 40)
    options, code, columns = ",matrix=10x4", 0xA4, 4


class Xela(TouchDevice):
    """The maker's server with two sensors: WebSocket and JSON, with values in hexadecimal (XELA,
    xela_server_ros2 3a890cf6)."""

    needs = "websockets"
    pads: ClassVar = {"sensor_1": 16, "sensor_3": 24}
    most = 65535

    @property
    def via(self) -> str:
        return f"xela:127.0.0.1:{self.port}"

    def plug(self) -> None:
        self._listens = threading.Event()
        super().plug()
        assert self._listens.wait(10.0)

    def message(self) -> dict[str, object]:
        found: dict[str, object] = {"message": int(100 * time.monotonic())}
        for pad, values in self.values.items():
            points = [word for one in values for word in (32768, 14256, one)][3 * self.short :]
            found[pad.removeprefix("sensor_")] = {
                "time": time.time(), "sensor": pad[-1], "model": "XR1944", "taxels": len(values),
                "data": ",".join(f"{word:04X}" for word in points),
                "calibrated": [word / 100 for word in points],
            }  # fmt: skip
        return found

    def serve(self) -> None:
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.server import ServerConnection, serve

        def talk(link: ServerConnection) -> None:
            link.send(json.dumps({"message": "Welcome"}))
            with suppress(ConnectionClosed):
                while self._in.is_set():
                    self.late()
                    if self.lose:
                        self.lose -= 1
                    else:
                        link.send(json.dumps(self.message()))
                    with suppress(TimeoutError):
                        self.received.append(str(link.recv(timeout=0.02)).encode())

        with serve(talk, "127.0.0.1", self.port, logger=logging.getLogger("xela")) as server:
            thread = threading.Thread(target=server.serve_forever, daemon=True)
            thread.start()
            self._listens.set()
            while self._in.is_set():
                time.sleep(0.02)
            server.shutdown()
