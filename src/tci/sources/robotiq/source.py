"""`robotiq:/dev/ttyACM0`: the static pressure of both fingers of Robotiq's TSF-85, 7 rows of 4, raw.

A packet is 9A, a checksum that is always 0, a command and a length; then fields, each of one byte with its
kind and finger, and big-endian values (Robotiq, tactile_sensors 8cb02198). Pressure comes 60 times a second,
inertial values 1000 times: a packet without a field of pressure is no frame of it. Nothing says when a packet
is damaged, so it counts only if its fields fill it exactly. The host subtracts a baseline, in no known unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tci.drivers.source import Sample
from tci.shared.serial_source import SerialSource

HEADER = 4
STATIC = 1
BYTES = {STATIC: 56, 2: 2, 3: 6, 4: 6, 5: 6, 6: 2, 7: 8}
"""Length of each kind of field: static and dynamic pressure, acceleration, rotation, magnetic field,
temperature, time."""
SEND = bytes((0x9A, 0x00, 0x58, 1, 10))
"""Asks for a packet every 10 ms."""


class RobotiqSource(SerialSource):
    """Two fingers, by the numbers that the packets give them."""

    pads: Mapping[str, int] = {"finger_0": 28, "finger_1": 28}
    device = "robotiq-tsf85"
    writes = f"the request to send packets, {SEND.hex(' ')}"
    mark = SEND[:1]
    baud = 115_200
    asks = True

    def start(self) -> None:
        self.port.write(SEND)

    def measure(self, data: bytes) -> int | None:
        if len(data) < HEADER or len(data) < HEADER + data[3]:
            return None
        size = HEADER + data[3]
        return size if sum(1 for _ in self._fields(data[:size])) else 0

    def samples(self, frame: bytes) -> Iterator[Sample]:
        for kind, finger, values in self._fields(frame):
            if kind == STATIC and f"finger_{finger}" in self.pads:
                yield Sample(f"finger_{finger}", np.frombuffer(values, ">u2").astype(np.uint16))

    @staticmethod
    def _fields(packet: bytes) -> list[tuple[int, int, bytes]]:
        """Kind, finger and bytes of each field; nothing if the fields don't fill the packet."""
        found, at = [], HEADER
        while at < len(packet):
            kind, finger = packet[at] >> 4, packet[at] >> 2 & 3
            at += 1 + BYTES.get(kind, len(packet))
            found.append((kind, finger, packet[at - BYTES.get(kind, 0) : at]))
        return found if at == len(packet) else []
