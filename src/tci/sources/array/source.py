"""`array:WHERE`: numbers as text lines from UDP, TCP or a serial port, from a topic of ROS 2 or ROS 1, or
from the program itself.

| WHERE | what it does |
|---|---|
| `udp://0.0.0.0:9000` | listens; each datagram is one or more lines |
| `tcp://HOST:PORT` | connects and reads lines |
| `serial:///dev/ttyACM0` | reads lines; option `baud`, by default 115200 |
| `ros2:///TOPIC` | a topic of ROS 2; options `path`, `type`, `msg`, `pack` and `ask` (`.topic`) |
| `ros1:///TOPIC` | a topic of ROS 1; options `path`, `type` and `pack` |
| `feed` | takes what the program gives to `driver.feed(patch, values)` |
"""

from __future__ import annotations

import queue
import re
import socket
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from tci.drivers.diagnosis import Finding
from tci.drivers.source import FingerAngles, Sample, Source, no_values
from tci.errors import CommandError, DriverError, FrameError
from tci.shared.serial_port import SerialPort
from tci.shared.serial_ports import findings
from tci.sources.array.lines import LineBuffer, sample_of
from tci.support.installed import needs

if TYPE_CHECKING:
    from tci.sources.array.topic import Topic

WAIT = 0.2
"""Longest time [s] of one `read`."""
PLACE = re.compile(r"(udp|tcp)://(\[[0-9a-fA-F:]+\]|[^:/\[\]]*):(\d{1,5})")
PORTS = 65536
ROS2, ROS1 = "ros2://", "ros1://"
VALID = "udp://0.0.0.0:9000, tcp://HOST:PORT, serial:///dev/ttyACM0, ros2:///TOPIC, ros1:///TOPIC, feed"


class ArraySource(Source):
    """Pads have the names of the robot's patches. With `patch=NAME` in the address, lines need no name."""

    def __init__(
        self,
        address: str = "",
        *,
        baud: str = "115200",
        missing: str = "-1",
        path: str = "",
        type: str = "",
        msg: str = "",
        pack: str = "",
        ask: str = "",
    ) -> None:
        """
        Args:
            address: See the module.
            baud: Speed of a serial port [1/s].
            missing: The number that means no value, beside NaN.
            path: Where the numbers are in a message of ROS; for several patches one for each, with strokes
                between them.
            type: Type of the message; empty for the one that its publisher says.
            msg: File or folder with the definition of the type, if no ROS package has it.
            pack: `be16` or `le16` if two bytes of the message are one value.
            ask: Topic of ROS 2 on which the device is asked for each message.

        Raises DriverError for an address or option that can't be meant, MissingExtraError without the library
        for ROS.
        """
        super().__init__(address)
        try:
            self._baud, self._missing = int(baud), float(missing)
        except ValueError as error:
            raise DriverError(f"array:{address}: {error}; valid: a number") from None
        self._place = PLACE.fullmatch(address)
        self._device = address.removeprefix("serial://") if address.startswith("serial://") else ""
        port = int(self._place[3]) if self._place else 0
        self._topic: Topic | None = None
        if address.startswith((f"{ROS2}/", f"{ROS1}/")):
            with needs(f"the source 'array:{address}'", "ros2"):
                from tci.sources.array.topic import Topic, ros1, ros2

                ros = ros2() if address.startswith(ROS2) else ros1()
            if msg and address.startswith(ROS1):
                raise DriverError(f"array:{address}: msg is for ros2; in ROS 1 publishers send definitions")
            if ask and (address.startswith(ROS1) or not ask.startswith("/")):
                raise DriverError(f"array:{address},ask={ask}; valid: ask=/TOPIC, for ros2:///TOPIC")
            self._topic = Topic(ros, address[len(ROS2) :], type_=type, path=path, msg=msg, pack=pack, ask=ask)
            if ask:
                self.writes = f"an empty message on {ask} for each one, at most 20 a second"
        elif path or type or msg or pack or ask:
            raise DriverError(
                f"array:{address}: path, type, msg, pack and ask are for ros2:///TOPIC, ros1:///TOPIC"
            )
        if not (self._place or self._device or self._topic or address == "feed") or port >= PORTS:
            raise DriverError(f"array:{address}; valid: {VALID}")
        self._socket: socket.socket | None = None
        self._serial: SerialPort | None = None
        self._lines = LineBuffer()
        self._fed: queue.SimpleQueue[Sample] = queue.SimpleQueue()

    def open(self) -> None:
        self._lines = LineBuffer()
        if self._topic is not None:
            self._topic.open(self.wants)
        elif self._device:
            self._serial = SerialPort(self._device, self._baud)
        elif self._place:
            kind, host, port = self._place[1], self._place[2].strip("[]"), int(self._place[3])
            if kind == "tcp":
                self._socket = socket.create_connection((host, port), timeout=2.0)
            else:
                family = socket.AF_INET6 if ":" in host else socket.AF_INET
                self._socket = socket.socket(family, socket.SOCK_DGRAM)
                self._socket.bind((host, port))
            self._socket.settimeout(WAIT)

    def read(self) -> Iterable[Sample | FingerAngles]:
        if self.address == "feed":
            return self._next_fed()
        if self._topic is not None:
            return [
                Sample(pad, no_values(values, self._missing), stamp)
                for pad, values, stamp in self._topic.read(WAIT)
            ]
        lines = self._lines.add(self._receive())
        found = []
        fault: FrameError | None = None
        for line in lines:
            try:
                if (sample := sample_of(line, self._default(), self._missing)) is not None:
                    found.append(sample)
            except FrameError as error:
                fault = error
        if fault is not None and not found:
            raise fault
        return found

    def diagnose(self) -> Iterator[Finding]:
        yield from findings(self._device)
        if self._topic is not None:
            yield from self._topic.diagnose()

    def close(self) -> None:
        if self._topic is not None:
            self._topic.close()
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def feed(self, pad: str, values: ArrayLike) -> None:
        if self.address != "feed":
            raise CommandError(f"array:{self.address} reads a device; valid for feed: array:feed")
        self._fed.put(Sample(pad, no_values(values, self._missing)))

    def _default(self) -> str:
        return self.wants[0] if len(self.wants) == 1 else ""

    def _next_fed(self) -> list[Sample]:
        try:
            return [self._fed.get(timeout=WAIT)]
        except queue.Empty:
            return []

    def _receive(self) -> bytes:
        if self._serial is not None:
            return self._serial.read(WAIT)
        assert self._socket is not None and self._place is not None
        try:
            data = self._socket.recv(65536)
        except TimeoutError:
            return b""
        if self._place[1] == "udp":
            return data if data.endswith(b"\n") else data + b"\n"
        if not data:
            raise ConnectionResetError(f"{self.address} closed the connection")
        return data
