"""Stand-ins for tactile devices on serial ports, made from what their makers or users publish. They import
nothing of TCI."""

from __future__ import annotations

import os
import pty
import select
import struct
import tempfile
import time
import tty
from abc import abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from helpers.touch_devices import Lines, TouchDevice


class SerialDevice(TouchDevice):
    """A device on a pseudo-terminal, whose name stays when it is unplugged. It sends a frame every 20 ms
    while it is `pushing`, and answers requests."""

    source: ClassVar[str]
    """Its name for TCI."""
    options = ""
    pushing = True
    alone, second = True, False

    def __init__(self) -> None:
        super().__init__()
        self.path = Path(tempfile.mkdtemp()) / "tty"

    @property
    def via(self) -> str:
        return f"{self.source}:{self.path}{self.options}"

    @abstractmethod
    def frame(self) -> bytes:
        """What is pushed."""

    def size_of_request(self, heard: bytes) -> int:
        """Length of the request that `heard` begins with."""
        return len(heard)

    def answer(self, request: bytes) -> bytes:
        return b""

    def plug(self) -> None:
        self._device, self._port = pty.openpty()
        tty.setraw(self._port)
        os.set_blocking(self._device, False)
        self.path.symlink_to(os.ttyname(self._port))
        self.pushing = type(self).pushing
        super().plug()

    def unplug(self) -> None:
        super().unplug()
        if self.path.is_symlink():
            self.path.unlink()
            os.close(self._device)
            os.close(self._port)

    def serve(self) -> None:
        heard, due = b"", time.monotonic()
        while self._in.is_set():
            if select.select([self._device], [], [], max(0.0, due - time.monotonic()))[0]:
                heard += os.read(self._device, 4096)
            while heard and len(heard) >= (size := self.size_of_request(heard)):
                request, heard = heard[:size], heard[size:]
                self.received.append(request)
                if answer := self.answer(request):
                    self.send(answer)
            if time.monotonic() >= due:
                due = time.monotonic() + 0.02
                if self.pushing:
                    self.send(self.frame())

    def send(self, data: bytes) -> None:
        """Waits for whoever reads, as a slow line does."""
        self.late()
        if self.lose:
            self.lose -= 1
            return
        while data and self._in.is_set():
            if select.select([], [self._device], [], 0.05)[1]:
                with suppress(BlockingIOError):
                    data = data[os.write(self._device, data) :]


class SerialLines(SerialDevice, Lines):
    """A board that prints its values, as a sketch of Arduino does."""

    source = "array"
    most = 1023

    @property
    def via(self) -> str:
        return f"array:serial://{self.path}"

    def frame(self) -> bytes:
        return "".join(self.lines()).encode()


class Flexitac(SerialDevice):
    """AA 55, then 12 x 32 bytes (PyPI flexitac 0.3.1, template.ino)."""

    source = "flexitac"
    pads: ClassVar = {"pad": 384}
    most = 255

    def frame(self) -> bytes:
        return b"\xaa\x55" + bytes(self.values["pad"][self.short :])


class Anyskin(SerialDevice):
    """Five times temperature and three fields as float32, then CR LF (PyPI anyskin 1.0.0). There is a CR LF
    in each temperature of 26.005 degrees C."""

    source = "anyskin"
    pads: ClassVar = {"pad": 15}

    def frame(self) -> bytes:
        chips = [self.values["pad"][k : k + 3] for k in range(0, 15, 3)]
        floats = b"".join(b"\r\n\xd0\x41" + struct.pack("<3f", *chip) for chip in chips)
        return floats[4 * self.short :] + b"\r\n"


class Robotiq(SerialDevice):
    """Packets of fields once asked (Robotiq, tactile_sensors 8cb02198): pressure in every second one, and
    inertial values in all. A length is one byte, so each finger has its own packet."""

    source = "robotiq"
    pads: ClassVar = {"finger_0": 28, "finger_1": 28}
    pushing = False

    def answer(self, request: bytes) -> bytes:
        self.pushing |= request == bytes.fromhex("9a0058010a")
        return b""

    def may_be_sent(self, request: bytes) -> bool:
        return request == bytes.fromhex("9a0058010a")

    def frame(self) -> bytes:
        found = b""
        for finger, values in enumerate(self.values.values()):
            pressure = bytes((0x10 | finger << 2,)) + struct.pack(">28H", *values)
            inertia = bytes((0x30 | finger << 2,)) + struct.pack(">3h", 0x9A, -3, 0x9A00 - 65536)
            moment = bytes((0x70 | finger << 2,)) + struct.pack(">Q", time.monotonic_ns() // 1000)
            for fields in (inertia + pressure[: len(pressure) - 2 * self.short] + moment, inertia):
                found += bytes((0x9A, 0, 0x58, len(fields))) + fields
        return found


def with_lrc(data: bytes) -> bytes:
    return data + bytes((256 - sum(data) % 256 & 0xFF,))


class Paxini(SerialDevice):
    """The high-speed board with three sensors (PyPI paxini-sdk 0.1.0)."""

    source = "paxini"
    modules: ClassVar = {"thumb_tip": 2, "index_nail": 7, "palm_3": 22}
    pads: ClassVar = {"thumb_tip": 31, "index_nail": 10, "palm_3": 12}
    kinds = 3
    pushing = False
    most = 255

    def forces(self, pad: str) -> list[tuple[int, int, int]]:
        """Along x, y and z of each point, in 0.1 N."""
        return [(k % 256 - 128, (5 * k) % 256 - 128, value) for k, value in enumerate(self.values[pad])]

    def frame(self) -> bytes:
        data = b"\x00"
        for pad in self.pads:
            if self.kinds & 1:
                data += struct.pack("<6B", 1, 2, 3, 4, 5, 6)
            if self.kinds & 2:
                points = self.forces(pad)[self.short :]
                data += b"".join(struct.pack("<bbB", *point) for point in points)
        return with_lrc(b"\xaa\x56\x00" + struct.pack("<H", len(data)) + data)

    def size_of_request(self, heard: bytes) -> int:
        size = struct.unpack_from("<H", heard, 6)[0] if heard[3:4] == b"\x10" and len(heard) > 8 else 0
        return 9 + int(size)

    def answer(self, request: bytes) -> bytes:
        register, size = struct.unpack_from("<HH", request, 4)
        if request[3] == 0x03:
            memory = bytearray(0x200)
            struct.pack_into("<I", memory, 0x10, sum(1 << module for module in self.modules.values()))
            memory[0x16] = self.kinds
            for pad, module in self.modules.items():
                struct.pack_into("<H", memory, 0x30 + 2 * module, self.pads[pad])
            return with_lrc(b"\xaa\x55" + request[2:8] + bytes(memory[register : register + size]))
        if register == 0x16:
            self.kinds = request[8]
        elif register == 0x17:
            self.pushing = request[8] == 1
        return with_lrc(b"\xaa\x55" + request[2:6] + b"\x01\x00\x00")

    def may_be_sent(self, request: bytes) -> bool:
        register, size = struct.unpack_from("<HH", request, 4)
        reads = {(0x10, 4), (0x16, 1), (0x30, 56)}
        writes = {(0x16, b"\x03"), (0x17, b"\x00"), (0x17, b"\x01")}
        asked = (register, size) in reads and request[3] == 3
        told = (register, request[8:-1]) in writes and request[3] == 16
        return request[:3] == b"\x55\xaa\x00" and sum(request) % 256 == 0 and (asked or told)


class Orca(Paxini):
    """The hand of ORCA, whose tips are the third modules; it pushes no points at first, and the angles of its
    joints in between (PyPI orca-core 0.12.0)."""

    source = "orca"
    modules: ClassVar = {"thumb_tip": 2, "index_tip": 6, "middle_tip": 10, "ring_tip": 14, "little_tip": 18}
    pads: ClassVar = {"thumb_tip": 51, "index_tip": 87, "middle_tip": 87, "ring_tip": 87, "little_tip": 51}
    kinds = 0

    def frame(self) -> bytes:
        counts = [1000 + 100 * k for k in range(17)]
        words = [count | (count.bit_count() % 2) << 15 for count in counts]
        words[3] |= 1 << 14  # an encoder's error, which also breaks the parity
        angles = struct.pack("<H", 35) + b"\x00" + struct.pack("<17H", *words)
        return with_lrc(b"\xaa\xa9\x00" + angles) + super().frame()


class PaxiniSensor(Paxini):
    """The serial converter board with one sensor: it answers only, with the status "wrong length"."""

    source = "paxini-sensor"
    options = ",part=S1813-Elite"
    pads: ClassVar = {"pad": 31}

    def size_of_request(self, heard: bytes) -> int:
        return 14

    def answer(self, request: bytes) -> bytes:
        data = b"".join(struct.pack("<bbB", *point) for point in self.forces("pad")[self.short :])
        size = struct.pack("<H", len(data))
        head = b"\xaa\x55" + struct.pack("<H", len(data) + 10) + request[4:11] + size + b"\x01"
        return with_lrc(head + data)

    def may_be_sent(self, request: bytes) -> bool:
        return request == with_lrc(bytes.fromhex("55aa09000100fb0e0400005d00"))


def with_crc(data: bytes) -> bytes:
    """As Modbus RTU has it."""
    rest = 0xFFFF
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = (rest >> 1) ^ (0xA001 * (rest & 1))
    return data + struct.pack("<H", rest)


class Brainco(SerialDevice):
    """The right Revo2 hand with one of four kinds of sensor (PyPI bc-stark-sdk 2.0.8)."""

    source = "brainco"
    kind: ClassVar[int]
    touch: ClassVar[set[tuple[int, int]]]
    """First and number of the registers that hold touch."""
    slave = 0x7F
    pushing = False

    @abstractmethod
    def memory(self) -> dict[int, list[int]]:
        """Input registers, by the first of each block."""

    def frame(self) -> bytes:
        return b""

    def size_of_request(self, heard: bytes) -> int:
        return 8

    def answer(self, request: bytes) -> bytes:
        slave, function, register, size = struct.unpack_from(">BBHH", request)
        if slave != self.slave or with_crc(request[:-2]) != request:
            return b""
        own = {(3, 970): [self.kind], (4, 2000): [0, 100, 200, 400, 700, 1000]}
        words = own.get((function, register), self.memory().get(register))
        if words is None or len(words) != size:
            return with_crc(bytes((slave, function | 0x80, 2)))
        words = words[self.short :] if function == 4 else words
        return with_crc(bytes((slave, function, 2 * len(words))) + struct.pack(f">{len(words)}H", *words))

    def may_be_sent(self, request: bytes) -> bool:
        slave, function, *asked = struct.unpack_from(">BBHH", request)
        known = (function == 3 and asked == [970, 1]) or (
            function == 4 and tuple(asked) in self.touch | {(2000, 6)}
        )
        return with_crc(request[:-2]) == request and slave in (0x7E, 0x7F) and known


class BraincoPressure(Brainco):
    """Nine points on each finger, and the palm's."""

    kind = 2
    touch: ClassVar = {(6010, 91)}
    pads: ClassVar = {
        **{f"right_{one}": 9 for one in ("thumb", "index", "middle", "ring", "little")},
        "right_palm": 46,
    }

    def memory(self) -> dict[int, list[int]]:
        return {6010: [one for values in self.values.values() for one in values]}


class BraincoCapacitive(Brainco):
    """One normal force and proximity on each finger; the left hand."""

    kind, slave = 1, 0x7E
    touch: ClassVar = {(4200, 30)}
    pads: ClassVar = {
        f"left_{one}{kind}": 1
        for kind in ("", "_proximity")
        for one in ("thumb", "index", "middle", "ring", "little")
    }

    def memory(self) -> dict[int, list[int]]:
        normal, near = [one for (one,) in self.values.values()], []
        for value in normal[5:]:
            near += [value + 1, value]
        return {4200: [word for one in normal[:5] for word in (one, 11, 12)] + near + 5 * [0]}


class BraincoForces(Brainco):
    """Three forces at 31 points of each finger but the thumb: two registers each."""

    kind = 4
    touch: ClassVar = {(7200 + 100 * k, 62) for k in range(4)}
    pads: ClassVar = {f"right_{one}": 31 for one in ("index", "middle", "ring", "little")}

    def memory(self) -> dict[int, list[int]]:
        return {
            7200 + 100 * k: [word for j, one in enumerate(values) for word in (0xF600 + j, one)]
            for k, values in enumerate(self.values.values())
        }


class BraincoArray(Brainco):
    """Three forces and two moments on each finger."""

    kind = 3
    touch: ClassVar = {(8100, 25)}
    pads: ClassVar = {f"right_{one}": 1 for one in ("thumb", "index", "middle", "ring", "little")}

    def memory(self) -> dict[int, list[int]]:
        return {
            8020: [1, 1],
            8100: [word for (one,) in self.values.values() for word in (0xFFFB, 6, one, 7, 8)],
        }


SERIAL_DEVICES: list[type[SerialDevice]] = [
    SerialLines,
    Flexitac,
    Anyskin,
    Robotiq,
    Paxini,
    Orca,
    PaxiniSensor,
    BraincoPressure,
]
