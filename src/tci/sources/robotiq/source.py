"""`robotiq:/dev/ttyACM0`: the static pressure of both fingers of Robotiq's TSF-85, 7 rows of 4, raw.

A packet is 9A, a checksum that is always 0, a command and a length; then fields, each of one byte with its
kind and finger, and big-endian values (Robotiq, tactile_sensors 8cb02198). Pressure comes 60 times a second,
inertial values 1000 times: a packet without a field of pressure is no frame of it. Nothing says when a packet
is damaged, so it counts only if its fields fill it exactly. The host subtracts a baseline, in no known unit.
A finger counts time in ticks that nobody explains (`ticks`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

import numpy as np

from tci.drivers.source import Sample
from tci.shared.serial_source import SerialSource
from tci.sources.robotiq.ticks import Ticks

HEADER = 4
STATIC, TIME = 1, 7
BYTES = {STATIC: 56, 2: 2, 3: 6, 4: 6, 5: 6, 6: 2, TIME: 8}
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
        self._ticks: dict[str, Ticks] = {}
        self.port.write(SEND)

    def measure(self, data: bytes) -> int | None:
        if len(data) < HEADER or len(data) < HEADER + data[3]:
            return None
        size = HEADER + data[3]
        return size if sum(1 for _ in self._fields(data[:size])) else 0

    def samples(self, frame: bytes) -> Iterator[Sample]:
        fields = self._fields(frame)
        counts = {finger: int.from_bytes(value) for kind, finger, value in fields if kind == TIME}
        for kind, finger, values in fields:
            pad = f"finger_{finger}"
            if kind == STATIC and pad in self.pads:
                ticks = self._ticks.setdefault(pad, Ticks())
                stamp = ticks.seconds(counts[finger], time.monotonic()) if finger in counts else None
                yield Sample(pad, np.frombuffer(values, ">u2").astype(np.uint16), stamp)

    @staticmethod
    def _fields(packet: bytes) -> list[tuple[int, int, bytes]]:
        """Kind, finger and bytes of each field; nothing if the fields don't fill the packet."""
        found, at = [], HEADER
        while at < len(packet):
            kind, finger = packet[at] >> 4, packet[at] >> 2 & 3
            at += 1 + BYTES.get(kind, len(packet))
            found.append((kind, finger, packet[at - BYTES.get(kind, 0) : at]))
        return found if at == len(packet) else []
