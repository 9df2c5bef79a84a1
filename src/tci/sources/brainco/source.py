"""`brainco:/dev/ttyUSB0`: touch of a BrainCo Revo2 hand over Modbus RTU. Reads only.

The hand says which of four kinds of sensor it has, and by its address which hand it is (registers: PyPI
bc-stark-sdk 2.0.8, of the maker). An answer does not say for which registers it is, so a late one could be
taken for another finger's: a timeout closes the port.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source import FingerAngles, Sample, Source
from tci.errors import DriverError, FrameError
from tci.shared.axes import along, values_per_point
from tci.shared.serial_port import SerialPort
from tci.shared.serial_ports import findings

FINGERS = ("thumb", "index", "middle", "ring", "little")
HANDS = {0x7E: "left", 0x7F: "right"}
SETTINGS, VALUES = 3, 4
"""Modbus functions: read holding registers, read input registers."""
KIND = 970
CAPACITIVE, PRESSURE, ARRAY, FORCES = 1, 2, 3, 4
"""Normal force and proximity of a finger; 9 points of pressure, and 46 on the palm; one force of a finger; 31
forces, and none on the thumb."""
ANGLES = 2000
JOINTS = ("thumb", "thumb_aux", "index", "middle", "ring", "little")
"""Order of the angles from this register, 0 to 1000; 0 is open (the maker's PyPI bc-stark-sdk 2.0.8)."""
TRIES = 3
"""A hand that told its angles in none of so many sweeps is asked for them no more: each try would close the
port."""
FORCE_POINTS = 31
PATIENCE = 0.2
"""Longest time [s] until an answer."""


def crc(data: bytes) -> bytes:
    """Of Modbus RTU: polynomial A001, low byte first."""
    rest = 0xFFFF
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = rest >> 1 ^ (0xA001 if rest & 1 else 0)
    return rest.to_bytes(2, "little")


class BraincoSource(Source):
    """Pads are `left_thumb` to `left_little`, or `right_..`; also `left_palm` and `left_thumb_proximity`."""

    writes = (
        "requests to read the kind of sensor (function 3, register 970) and its values (function 4, "
        "registers 4200, 6010, 7200 to 7561 or 8100), and its angles (function 4, register 2000)"
    )
    joints = JOINTS
    hand = "brainco-revo2"

    def __init__(self, address: str = "", *, baud: str = "460800", slave: str = "", axes: str = "z") -> None:
        """
        Args:
            address: The serial port.
            baud: Its speed [1/s].
            slave: 126 is the left hand, 127 the right one; by default the one that answers.
            axes: z for the force across a point, xyz for all three, of hands that measure them.

        Raises DriverError for an option that can't be meant.
        """
        super().__init__(address)
        if not address or not baud.isdecimal():
            raise DriverError(
                f"brainco:{address},baud={baud}; valid: brainco:/dev/ttyUSB0, or with ,baud=460800"
            )
        if slave and (not slave.isdecimal() or int(slave) not in HANDS):
            raise DriverError(f"brainco:{address},slave={slave}; valid: 126 (left), 127 (right)")
        self._slaves = [int(slave)] if slave else [*HANDS]
        self._axes, self.values_per_point = axes, values_per_point(axes)
        self._speed, self._kind = int(baud), 0
        self._port: SerialPort | None = None
        self._tries: float = TRIES

    def find_pads(self) -> None:
        try:
            self.open()
        finally:
            self.close()
        side = f"{HANDS[self._slaves[0]]}_"
        sizes = {
            CAPACITIVE: {**dict.fromkeys(FINGERS, 1), **{f"{finger}_proximity": 1 for finger in FINGERS}},
            PRESSURE: {**dict.fromkeys(FINGERS, 9), "palm": 46},
            ARRAY: dict.fromkeys(FINGERS, self.values_per_point),
            FORCES: dict.fromkeys(FINGERS[1:], FORCE_POINTS * self.values_per_point),
        }
        self.pads = {side + pad: size for pad, size in sizes[self._kind].items()}

    def open(self) -> None:
        self._port = SerialPort(self.address, self._speed, writes=True)
        for slave in self._slaves:
            self._slaves = [slave]
            try:
                self._kind = int(self._registers(SETTINGS, KIND, 1)[0])
            except TimeoutError:
                continue
            if not CAPACITIVE <= self._kind <= FORCES:
                raise DriverError(f"the hand has touch sensors of the kind {self._kind}; valid: 1 to 4")
            return
        raise DriverError(f"no hand answers on {self.address}; check its power, and baud={self._speed}")

    def read(self) -> Iterator[Sample | FingerAngles]:
        side = f"{HANDS[self._slaves[0]]}_"
        for pad, values in self._values():
            if side + pad in self.pads:
                yield Sample(side + pad, values)
        if self._tries:
            self._tries -= 1
            angles = self._registers(VALUES, ANGLES, len(JOINTS)).astype(float) / 1000.0
            self._tries = np.inf
            yield FingerAngles(dict(zip(JOINTS, angles.tolist(), strict=True)))

    def _values(self) -> Iterator[tuple[str, NDArray[np.generic]]]:
        if self._kind == CAPACITIVE:
            raw = self._registers(VALUES, 4200, 30)
            near = raw[15:25].astype(">u2").view(">u4").astype(np.uint32)
            for k, finger in enumerate(FINGERS):
                yield finger, raw[3 * k : 3 * k + 1]
                yield f"{finger}_proximity", near[k : k + 1]
        elif self._kind == PRESSURE:
            raw = self._registers(VALUES, 6010, 91)
            for k, finger in enumerate(FINGERS):
                yield finger, raw[9 * k : 9 * k + 9]
            yield "palm", raw[45:]
        elif self._kind == ARRAY:
            forces = self._registers(VALUES, 8100, 25).reshape(5, 5)[:, :3]
            for k, finger in enumerate(FINGERS):
                yield finger, along(forces[k : k + 1], self._axes)
        else:
            for k, finger in enumerate(FINGERS[1:]):
                raw = self._registers(VALUES, 7200 + 100 * k, 2 * FORCE_POINTS)
                sideways = raw[::2].astype(">u2").view(np.int8).reshape(-1, 2)
                points = np.column_stack([sideways, raw[1::2]]).astype(np.int32)
                yield finger, along(points, self._axes)

    def diagnose(self) -> Iterator[Finding]:
        yield from findings(self.address)
        if not self._tries:
            words = f"the hand does not tell the angles of its fingers (register {ANGLES}); its touch is read"
            yield Finding(Level.NOTE, self.address, words, "see whether its firmware is the latest")

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _registers(self, function: int, register: int, size: int) -> NDArray[np.uint16]:
        """Raises FrameError for an answer that can't be used, TimeoutError if none comes in time."""
        if self._port is None:
            raise ConnectionResetError("not open")
        self._port.read(0.0)  # what nobody waits for
        head = bytes((self._slaves[0], function))
        request = head + register.to_bytes(2, "big") + size.to_bytes(2, "big")
        self._port.write(request + crc(request))
        answer, end = b"", time.monotonic() + PATIENCE
        while len(answer) < 5 or len(answer) < (5 if answer[1] & 0x80 else 5 + answer[2]):
            left = end - time.monotonic()
            if left <= 0:
                raise TimeoutError(f"no answer within {PATIENCE:g} s")
            answer += self._port.read(left)
        if crc(answer[:-2]) != answer[-2:]:
            raise FrameError("an answer with a wrong checksum")
        if answer[1] & 0x80:
            raise FrameError(f"the hand refuses to read register {register}: code {answer[2]}")
        if answer[:3] != head + bytes((2 * size,)):
            raise FrameError(f"register {register}: {answer[2]} bytes, expected {2 * size}")
        return np.frombuffer(answer, ">u2", size, 3).astype(np.uint16)
