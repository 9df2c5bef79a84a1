"""`paxini-sensor:/dev/ttyUSB0,part=S2015`: one sensor on PaXini's serial converter board, in steps of 0.1 N.

The board answers requests: 55 AA, length, device, 00, FB, address, number of bytes and a checksum; its answer
has a status before the data, which says 1, "wrong length", also when all is right (PyPI paxini-sdk 0.1.0, on
a sensor). It can't tell which sensor it has: the option names the part, or the number of its points.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from tci.drivers.source import Sample
from tci.errors import DriverError, FrameError
from tci.shared.axes import along, values_per_point
from tci.shared.serial_source import WAIT, SerialSource
from tci.sources.paxini.frames import ANSWER, BAUD, POINT, REQUEST, points, with_checksum

PARTS = {
    "L5325": 239, "M3025": 77, "L3530": 135, "M2826": 127, "S2716": 116, "S1813-Core": 51, "S3013": 96,
    "S1813-Elite": 31, "S2015": 52, "M2324": 68, "S1610": 25, "M2020": 9,
}  # fmt: skip
"""Points of each part of the series GEN3 (the data of PyPI paxini-sdk 0.1.0)."""
FORCES = 0x040E
HEADER = 13
PATIENCE = 0.3
"""Longest time [s] until an answer."""


class PaxiniSensorSource(SerialSource):
    """One pad."""

    writes = "requests to read the forces, function FB, address 040E"
    mark = ANSWER
    baud = BAUD
    asks = True

    def __init__(
        self, address: str = "", *, baud: str = "", part: str = "", points: str = "", axes: str = "z"
    ) -> None:
        """
        Args:
            address: The serial port.
            baud: Its speed [1/s].
            part: The sensor, by the part of its name that tells its size.
            points: The number of its points, for a part that is not in the list.
            axes: z for the force across each point, xyz for all three.

        Raises DriverError for an option that can't be meant.
        """
        super().__init__(address, baud=baud)
        if part not in PARTS and not (points.isdecimal() and 1 <= int(points) <= 1000):
            raise DriverError(
                f"paxini-sensor:{address}: which sensor is it? valid: ,part={', '.join(PARTS)} or ,points=52"
            )
        self._bytes, self._axes = POINT * int(points or PARTS[part]), axes
        self.values_per_point = values_per_point(axes)
        self.pads = {"pad": self._bytes // POINT * self.values_per_point}
        request = bytes((*REQUEST, 9, 0, 1, 0, 0xFB)) + FORCES.to_bytes(4, "little")
        self._request = with_checksum(request + self._bytes.to_bytes(2, "little"))

    def measure(self, data: bytes) -> int | None:
        if len(data) < HEADER:
            return None
        size = HEADER + 1 + int.from_bytes(data[11:13], "little") + 1
        if size > HEADER + 2 + self._bytes:
            return 0
        if len(data) < size:
            return None
        return size if sum(data[:size]) & 0xFF == 0 else 0

    def read(self) -> Iterator[Sample]:
        """One request and its answer. Raises OSError if none comes, as a late one would be the next one's."""
        self.port.write(self._request)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for frame in self.frames(WAIT):
                yield from self.samples(frame)
                return
        raise TimeoutError(f"no answer within {PATIENCE:g} s")

    def samples(self, frame: bytes) -> Iterator[Sample]:
        if frame[HEADER] > 1:
            raise FrameError(f"the board tells the error {frame[HEADER]}")
        data = frame[HEADER + 1 : -1]
        if len(data) != self._bytes:
            raise FrameError(f"{len(data)} bytes, expected {self._bytes}; is it this part?")
        yield Sample("pad", along(points(data), self._axes))
