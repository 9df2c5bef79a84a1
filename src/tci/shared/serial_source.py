"""Frames from a serial port: what tactile devices on one have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import ClassVar

from tci.drivers.diagnosis import Finding
from tci.drivers.source import FingerAngles, Sample, Source
from tci.errors import DriverError, FrameError
from tci.shared.serial_port import SerialPort
from tci.shared.serial_ports import findings

WAIT = 0.2
"""Longest time [s] of one `read`."""
MUCH = 20_000
"""Bytes without any frame after which that is told: 10 frames and more of every device here."""


class SerialSource(Source):
    """A device whose frames begin with a mark. To add one: `mark`, `baud`, `measure` and `samples`, and
    `start` if it sends nothing unasked.

    A mark may also occur among the values, and bytes get lost, so a frame counts only where `measure` is
    sure of it. Bytes between two frames are told; those before the first are a frame that began earlier.
    """

    mark: ClassVar[bytes]
    baud: ClassVar[int]
    """Speed of the port as sold [1/s]."""
    asks: ClassVar[bool] = False
    """Whether anything is sent to the device."""

    def __init__(self, address: str = "", *, baud: str = "") -> None:
        """Raises DriverError for an address that is no path, or a speed that is no number."""
        super().__init__(address)
        if not address or not (baud or "1").isdecimal():
            said = f"{address or 'no serial port'}{f', baud={baud}' if baud else ''}"
            raise DriverError(f"{said}; valid: NAME:/dev/ttyACM0, or with ,baud={self.baud}")
        self._speed = int(baud or self.baud)
        self._port: SerialPort | None = None

    @abstractmethod
    def measure(self, data: bytes) -> int | None:
        """Length of the frame at the beginning of `data`, which begins with the mark. 0 if none begins there,
        None if more bytes must come before that is sure."""

    @abstractmethod
    def samples(self, frame: bytes) -> Iterable[Sample | FingerAngles]:
        """What is in a frame. Raises FrameError for one that can't be used."""

    def start(self) -> None:
        """Lets the device send."""

    def open(self) -> None:
        self._port = SerialPort(self.address, self._speed, writes=self.asks)
        self._rest = b""
        self._odd, self._begun = 0, False
        self.start()

    def read(self) -> Iterator[Sample | FingerAngles]:
        fault: FrameError | None = None
        for frame in self.frames(WAIT):
            try:
                yield from self.samples(frame)
            except FrameError as error:
                fault = error
        if fault is not None:
            raise fault
        if self._begun and self._odd:
            self._odd = 0
            raise FrameError("bytes between frames: a frame of the wrong length, or noise on the line")
        if self._odd > MUCH:
            self._odd = 0
            raise FrameError(f"bytes, but no frame; valid: the device of this source, at {self._speed} baud")

    def frames(self, wait: float) -> Iterator[bytes]:
        """The frames that arrived within `wait` [s]."""
        self._rest += self.port.read(wait)
        while (begin := self._rest.find(self.mark)) >= 0:
            self._odd += begin
            self._rest = self._rest[begin:]
            size = self.measure(self._rest)
            if size is None:
                return
            if size:
                frame, self._rest = self._rest[:size], self._rest[size:]
                self._odd, self._begun = self._odd if self._begun else 0, True
                yield frame
            else:
                self._odd += 1
                self._rest = self._rest[1:]
        kept = len(self.mark) - 1
        self._odd += max(0, len(self._rest) - kept)
        self._rest = self._rest[-kept:] if kept else b""

    def diagnose(self) -> Iterator[Finding]:
        return findings(self.address)

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    @property
    def port(self) -> SerialPort:
        if self._port is None:
            raise ConnectionResetError("not open")
        return self._port
