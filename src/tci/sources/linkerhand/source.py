"""`linkerhand:can0,side=right`: the finger tips of a LinkerHand over CAN. Reads only.

A request is a finger and the kind of its matrix; the answer is one message for each row, whose second byte
has the row (LinkerHand, linkerhand-ros2-sdk bba0b9d5). The hand does one finger at a time. Answers don't say
whose request they answer: don't read the bus beside the maker's node.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import can
import numpy as np
from numpy.typing import NDArray

from tci.drivers.source import FingerAngles, Sample, Source
from tci.errors import DriverError, FrameError
from tci.shared.serial_ports import can_channels

HANDS = {"right": 0x27, "left": 0x28}
FINGERS = {"thumb": 0xB1, "index": 0xB2, "middle": 0xB3, "ring": 0xB4, "little": 0xB5}
MATRICES = {"12x6": (0xC6, 12, 6), "10x4": (0xA4, 10, 4)}
"""Code of the request, rows, columns: nearly all hands; the O6."""
ANGLES = 0x01
"""Code of the request for angles. With values behind it, it would move the joints: none are sent."""
L6 = (
    "thumb_cmc_pitch",
    "thumb_cmc_yaw",
    *(f"{one}_mcp_pitch" for one in ("index", "middle", "ring", "pinky")),
)
"""Joints of the L6, in the order of its answer: 0 to 255, and 255 is open."""
BITRATE = 1_000_000
PATIENCE = 0.1
"""Longest time [s] until a finger is complete: 20 ms on another author's bus."""
BREATH = 0.0025
"""Time [s] between two requests, by PyPI linkerbot 0.5.4."""


class LinkerhandSource(Source):
    """Five pads, `thumb_tip` to `little_tip`, row by row."""

    writes = "requests to read the matrix of each finger, B1 to B5 with C6 or A4"
    device = "linkerhand"

    def __init__(
        self,
        address: str = "",
        *,
        side: str = "",
        matrix: str = "12x6",
        hand: str = "",
        interface: str = "socketcan",
    ) -> None:
        """
        Args:
            address: The channel, such as can0.
            side: Which hand, left or right: both may be on one bus.
            matrix: 12x6, or 10x4 for the O6.
            hand: L6 to read the angles of its joints too; others have other joints.
            interface: The kind of adapter, by its name in python-can.

        Raises DriverError for an option that can't be meant.
        """
        super().__init__(address)
        if not address or side not in HANDS or matrix not in MATRICES or hand not in ("", "L6"):
            raise DriverError(
                f"linkerhand:{address},side={side},matrix={matrix}; valid: linkerhand:can0,side=left or "
                f"side=right, matrix={' or '.join(MATRICES)}, hand=L6"
            )
        self._id, self._interface = HANDS[side], interface
        self._code, self._rows, self._columns = MATRICES[matrix]
        self.pads = {f"{finger}_tip": self._rows * self._columns for finger in FINGERS}
        if matrix == "10x4":
            self.device = "linkerhand-o6"
        if hand:
            self.hand, self.joints = "linkerhand-l6", L6
            self.writes = f"{type(self).writes}; and the angles of its joints, 01"
        self._bus: can.BusABC | None = None
        self._echoes = 0
        """Requests that came back in this sweep."""

    def open(self) -> None:
        advice = f"bring it up: sudo ip link set {self.address} up type can bitrate {BITRATE}"
        if self._interface == "socketcan" and can_channels().get(self.address) == "down":
            raise DriverError(f"{self.address} is down; {advice}")
        try:
            self._bus = can.Bus(channel=self.address, interface=self._interface, bitrate=BITRATE)
        except can.CanError as error:
            raise DriverError(f"{error}; {advice}") from error

    def read(self) -> Iterator[Sample | FingerAngles]:
        """One sweep. Raises FrameError if rows got lost, DriverError if the hand says nothing at all."""
        lost, heard = [], False
        self._echoes = 0
        for finger, number in FINGERS.items():
            if f"{finger}_tip" not in self.wants:
                continue
            rows = self._rows_of(number)
            heard |= bool(rows)
            if len(rows) == self._rows:
                yield Sample(f"{finger}_tip", np.concatenate(rows))
            else:
                lost.append(finger)
            time.sleep(BREATH)
        if not heard:
            said = "only our own requests come back" if self._echoes else "no answer"
            raise DriverError(
                f"{said} from the hand with the id 0x{self._id:02x}: power it, then replug the adapter; or "
                "try the other side="
            )
        if self.joints and (angles := self._angles()) is not None:
            yield FingerAngles(dict(zip(self.joints, angles, strict=True)))
        if lost:
            raise FrameError(f"rows of the {', '.join(lost)} are missing or have not {self._columns} values")

    def close(self) -> None:
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _rows_of(self, finger: int) -> list[NDArray[np.uint8]]:
        """The rows that came, from the first one, without a gap."""
        if self._bus is None:
            raise ConnectionResetError("not open")
        rows: list[NDArray[np.uint8]] = []
        self._bus.send(can.Message(arbitration_id=self._id, data=(finger, self._code), is_extended_id=False))
        end = time.monotonic() + PATIENCE
        while len(rows) < self._rows and (left := end - time.monotonic()) > 0:
            message = self._bus.recv(left)
            if message is None or message.arbitration_id != self._id or len(message.data) < 3:
                self._echoes += message is not None and message.data == bytes((finger, self._code))
                continue
            row = message.data[1] >> 4
            if row == 0:
                rows.clear()
            if message.data[0] == finger and row == len(rows) and len(message.data) == 2 + self._columns:
                rows.append(np.frombuffer(message.data, np.uint8, offset=2))
        return rows

    def _angles(self) -> list[float] | None:
        """0 to 1, in the order of the joints; None if no answer came in time. Some hands answer 8 above their
        own id."""
        if self._bus is None:
            raise ConnectionResetError("not open")
        self._bus.send(can.Message(arbitration_id=self._id, data=(ANGLES,), is_extended_id=False))
        end = time.monotonic() + PATIENCE
        while (left := end - time.monotonic()) > 0:
            message = self._bus.recv(left)
            if message is None or message.arbitration_id not in (self._id, self._id + 8):
                continue
            if message.data[:1] == bytes((ANGLES,)) and len(message.data) == 1 + len(self.joints):
                return [value / 255.0 for value in message.data[1:]]
        return None
