"""Stand-ins for tactile devices, made from what their makers publish, with faults that a test switches on.
They import nothing of TCI."""

from __future__ import annotations

import socket
import struct
import threading
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import ClassVar


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

    def may_be_sent(self, request: bytes) -> bool:
        """Whether the device allows this, as far as its state is what matters: nothing may change it."""
        return False

    def plug(self) -> None:
        self._in.set()
        thread = threading.Thread(target=self.serve, daemon=True)
        thread.start()
        self._threads.append(thread)

    def unplug(self) -> None:
        self._in.clear()
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
        struct.pack_into(">6H", memory, 1546, 1000, 900, 800, 700, 600, 500)
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
