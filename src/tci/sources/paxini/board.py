"""`paxini:/dev/ttyUSB0`: all sensors on PaXini's high-speed board. Forces in steps of 0.1 N, as they are
pushed.

Requests are 55 AA 00, function, register, length (both little endian), data and a checksum; answers begin
with AA 55, and what the board pushes with AA 56 and its length (PyPI paxini-sdk 0.1.0; the project read no
manual). What is pushed has for each sensor that is there its sum, 6 bytes, then 3 bytes for each point, as
registers say that are read first. The board calibrates and resets on other writes, which are never sent.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from tci.drivers.source import FingerAngles, Sample
from tci.errors import DriverError, FrameError
from tci.shared.axes import along, values_per_point
from tci.shared.serial_source import WAIT, SerialSource
from tci.sources.paxini.frames import ANSWER, BAUD, POINT, REQUEST, points, with_checksum

PUSHED, ANGLES = b"\xaa\x56", b"\xaa\xa9"
READ, WRITE = 0x03, 0x10
PRESENT, KINDS, PUSH, COUNTS = 0x0010, 0x0016, 0x0017, 0x0030
"""Registers: which sensors are there, what is pushed, whether it is, and the points of each sensor."""
SUMS, POINTS = 1, 2
"""Bits of `KINDS`."""
SUM = 6
"""Bytes of the sum of a sensor."""
SENSORS = tuple(
    f"{finger}_{place}"
    for finger in ("thumb", "index", "middle", "ring", "little")
    for place in ("proximal", "middle", "tip", "nail")
) + tuple(f"palm_{k}" for k in range(1, 9))
"""By the bits of `PRESENT`."""
LONGEST = 8192
"""Longest frame [bytes]: more than 28 sensors send."""
PATIENCE = 0.5
"""Longest time [s] until an answer."""
MISFITS = 5
"""Frames of another length after which the board is asked again what is on it."""


class PaxiniSource(SerialSource):
    """One pad for each sensor on the board, which says which they are: `thumb_tip`, `palm_1` and others."""

    writes = (
        "requests to read the registers 0010, 0016 and 0030; 1 to 0017, which starts pushing, and 0, which "
        "ends it; 3 to 0016 if points are not pushed"
    )
    mark = b"\xaa"
    baud = BAUD
    asks = True

    def __init__(self, address: str = "", *, baud: str = "", axes: str = "z") -> None:
        """
        Args:
            address: The serial port.
            baud: Its speed [1/s].
            axes: z for the force across each point, xyz for all three.

        Raises DriverError for an option that can't be meant.
        """
        super().__init__(address, baud=baud)
        self._axes, self.values_per_point = axes, values_per_point(axes)
        self._kinds, self._misfits = SUMS | POINTS, 0

    def find_pads(self) -> None:
        try:
            self.open()
        finally:
            self.close()

    def start(self) -> None:
        there = int.from_bytes(self._read(PRESENT, 4), "little")
        counts = np.frombuffer(self._read(COUNTS, 2 * len(SENSORS)), "<u2")
        sizes = {name: int(counts[k]) for k, name in enumerate(SENSORS) if there >> k & 1}
        pads = {name: self.values_per_point * size for name, size in sizes.items()}
        if not pads:
            raise DriverError("the board has no sensor; check their cables")
        if self.pads and pads != self.pads:
            raise DriverError(f"the board has other sensors than at first: {', '.join(pads)}; connect again")
        self._kinds = self._read(KINDS, 1)[0]
        if not self._kinds & POINTS:
            self._kinds = SUMS | POINTS
            self._ask(WRITE, KINDS, bytes((self._kinds,)))
        self.pads, self._sizes, self._misfits = pads, sizes, 0
        self._ask(WRITE, PUSH, b"\x01")

    def measure(self, data: bytes) -> int | None:
        if len(data) < 8:
            return None
        if data.startswith((PUSHED, ANGLES)):
            size = 6 + int.from_bytes(data[3:5], "little")
        elif data.startswith(ANSWER):
            size = 9 + int.from_bytes(data[6:8], "little")
        else:
            return 0
        if not 9 <= size <= LONGEST:
            return 0
        if len(data) < size:
            return None
        return size if sum(data[:size]) & 0xFF == 0 else 0

    def samples(self, frame: bytes) -> Iterator[Sample | FingerAngles]:
        if not frame.startswith(PUSHED):
            return
        data, at, each = frame[6:-1], 0, SUM * bool(self._kinds & SUMS)
        expected = sum(each + POINT * size for size in self._sizes.values())
        if len(data) != expected:
            self._misfits += 1
            if self._misfits >= MISFITS:
                raise ConnectionResetError("a sensor came or went")
            raise FrameError(f"{len(data)} bytes pushed, expected {expected} for {len(self.pads)} sensors")
        self._misfits = 0
        if frame[5]:
            raise FrameError(f"the board tells the error {frame[5]}")
        for name, size in self._sizes.items():
            at += each
            yield Sample(name, along(points(data[at : at + POINT * size]), self._axes))
            at += POINT * size

    def close(self) -> None:
        if self._port is not None:
            with suppress(OSError):  # unplugged
                self._ask(WRITE, PUSH, b"\x00")
        super().close()

    def _read(self, register: int, size: int) -> bytes:
        """Raises DriverError if no answer comes."""
        self._ask(READ, register, size=size)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for frame in self.frames(WAIT):
                if frame[:6] == bytes((*ANSWER, 0, READ)) + register.to_bytes(2, "little"):
                    return frame[8:-1]
        raise DriverError(
            f"no answer from the board on {self.address}; check its power, and baud={self._speed}"
        )

    def _ask(self, function: int, register: int, data: bytes = b"", *, size: int = 0) -> None:
        head = bytes((*REQUEST, 0, function)) + register.to_bytes(2, "little")
        self.port.write(with_checksum(head + (size or len(data)).to_bytes(2, "little") + data))
