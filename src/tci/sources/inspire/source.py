"""`inspire:HOST[:PORT]`: touch and angles of an Inspire RH56DFTP hand over Modbus TCP. Reads only.

`inspire:dds://INTERFACE[/DOMAIN],side=left`: the same from the maker's bridge on a Unitree robot.

Addresses count bytes, counts are registers of two bytes (Inspire, manual PRJ-02-TS-U-001 V1.0.0). Words are
big endian: the author of PyPI inspire-rh56dftp 0.1.0 measured it on a hand. The hand echoes transaction ids
off by one, so ids are not compared; a late answer could be taken for another pad's, so a timeout closes the
connection. One request for each pad.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterable, Iterator, Mapping
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from tci.drivers.diagnosis import Finding
from tci.drivers.source import FingerAngles, Sample, Source
from tci.errors import DriverError, FrameError
from tci.support.installed import needs

if TYPE_CHECKING:
    from tci.sources.inspire.topics import InspireTopics

DDS = "dds://"
WAIT = 0.2
"""Longest time [s] of one `read` of a topic."""
PORT = 6000
TIMEOUT = 0.5
"""Longest time [s] that the hand may take for an answer."""
READ = 3
"""Modbus function: read holding registers."""
UNIT = 0xFF
"""As in the manual; the hand ignores it."""
ANGLES = 1546
JOINTS = ("little", "ring", "middle", "index", "thumb_bend", "thumb_rotation")
"""Order of the angles, which the hand gives in 0..1000; 1000 is open."""
FINGERS = ("little", "ring", "middle", "index")
REGISTERS: dict[str, tuple[int, int]] = {
    **{
        f"{finger}_{pad}": (first + 370 * i, size)
        for i, finger in enumerate(FINGERS)
        for pad, first, size in (("tip", 3000, 9), ("top", 3018, 96), ("pad", 3210, 80))
    },
    "thumb_tip": (4480, 9), "thumb_top": (4498, 96), "thumb_middle": (4690, 9), "thumb_pad": (4708, 96),
    "palm": (4900, 112),
}  # fmt: skip
"""Byte address and number of taxels of each pad."""


class InspireSource(Source):
    """The 17 pads of one hand, in the order of its registers; the palm comes column by column from its last
    row, as its patch says."""

    pads: Mapping[str, int] = {pad: size for pad, (_, size) in REGISTERS.items()}
    joints = JOINTS
    device = hand = "inspire-rh56dftp"
    writes = "requests to read (function 3) the touch registers 3000 to 5123 and the angles at 1546"

    def __init__(self, address: str = "", *, side: str = "") -> None:
        """`side` says which hand's topic is read, over DDS.

        Raises DriverError for an address without a host or a side, MissingExtraError without the library for
        DDS.
        """
        super().__init__(address)
        self._socket: socket.socket | None = None
        self._ids = count(1)
        self._topics: InspireTopics | None = None
        if address.startswith(DDS):
            interface, _, domain = address.removeprefix(DDS).partition("/")
            if not interface or not (domain or "0").isdecimal() or not side:
                raise DriverError(
                    f"inspire:{address}; valid: inspire:dds://eth0,side=left, or /DOMAIN behind eth0"
                )
            with needs(f"the source 'inspire:{address}'", "unitree"):
                from tci.sources.inspire.topics import InspireTopics
            self._topics = InspireTopics(interface, int(domain or 0), side)
            self.writes = "nothing"
            return
        host, _, port = address.rpartition(":") if ":" in address else (address, "", str(PORT))
        if not host or not port.isdecimal():
            raise DriverError(
                f"inspire:{address}; valid: inspire:HOST or inspire:HOST:PORT; as sold 192.168.11.210"
            )
        self._host, self._port = host, int(port)

    def open(self) -> None:
        if self._topics is not None:
            self._topics.open()
            return
        self._socket = socket.create_connection((self._host, self._port), timeout=2.0)
        self._socket.settimeout(TIMEOUT)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self) -> Iterable[Sample | FingerAngles]:
        """One sweep, each pad as soon as it is there; or the next message."""
        if self._topics is not None:
            yield from (
                one
                for one in self._topics.read(WAIT)
                if isinstance(one, FingerAngles) or one.pad in self.wants
            )
            return
        for pad, (address, size) in REGISTERS.items():
            if pad in self.wants:
                yield Sample(pad, self._registers(address, size))
        angles = self._registers(ANGLES, len(JOINTS)).astype(float) / 1000.0
        yield FingerAngles(dict(zip(JOINTS, angles.tolist(), strict=True)))

    def diagnose(self) -> Iterator[Finding]:
        if self._topics is not None:
            yield from self._topics.diagnose()

    def close(self) -> None:
        if self._topics is not None:
            self._topics.close()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _registers(self, address: int, size: int) -> np.ndarray:
        """(size,) uint16. Raises FrameError if the hand refuses, OSError if it does not answer in time or
        with another length."""
        link = self._socket
        if link is None:
            raise ConnectionResetError("not open")
        self._drain(link)
        number = next(self._ids) & 0xFFFF
        link.sendall(struct.pack(">HHHBBHH", number, 0, 6, UNIT, READ, address, size))
        end = time.monotonic() + TIMEOUT
        head = self._exactly(link, 8, end)
        _, protocol, length, _, function = struct.unpack(">HHHBB", head)
        if protocol != 0 or not 3 <= length <= 260:
            raise ConnectionResetError(f"no Modbus answer: {head.hex()}")
        body = self._exactly(link, length - 2, end)
        if function == READ | 0x80:
            raise FrameError(f"the hand refuses to read register {address}: code {body[0]}")
        if function != READ or body[0] != 2 * size or len(body) != 1 + 2 * size:
            raise ConnectionResetError(f"register {address}: {len(body) - 1} bytes, expected {2 * size}")
        return np.frombuffer(body, ">u2", offset=1).astype(np.uint16)

    @staticmethod
    def _drain(link: socket.socket) -> None:
        """Throws away what nobody waits for."""
        link.setblocking(False)
        try:
            while link.recv(4096):
                pass
            raise ConnectionResetError("the hand closed the connection")
        except BlockingIOError:
            pass
        finally:
            link.settimeout(TIMEOUT)

    @staticmethod
    def _exactly(link: socket.socket, size: int, end: float) -> bytes:
        data = b""
        while len(data) < size:
            if time.monotonic() > end:
                raise TimeoutError(f"no answer within {TIMEOUT:g} s")
            more = link.recv(size - len(data))
            if not more:
                raise ConnectionResetError("the hand closed the connection")
            data += more
        return data
