"""Base class of fault injectors. Every injector works on any driver, unless its `description` names a
restriction."""

from __future__ import annotations

from abc import ABC
from typing import ClassVar

from tci.drivers.driver import Driver
from tci.messages import JointReading, Reading, SkinFrame


class Injector(ABC):
    """A fault that is being injected."""

    number: ClassVar[int]
    """Number of the fault in the catalogue."""
    description: ClassVar[str]
    """Description of the fault, for `tci fault list`."""
    shows_after: ClassVar[float] = 0.0
    """Longest time [s] from the start of the fault until TCI can detect the fault."""

    def __init__(self, driver: Driver, first: Reading) -> None:
        """Stores `first`, the last correct reading before the fault."""
        self.driver = driver
        self.first = first
        self.begin()

    def begin(self) -> None:
        """Starts the fault. Called once, at the start of the fault."""
        return

    def read(self, reading: Reading) -> Reading:
        """Returns the faulty reading that replaces `reading`."""
        return Reading(self.joints(reading.joints), tuple(map(self.frame, reading.skin)))

    def joints(self, joints: JointReading) -> JointReading:
        """Returns the faulty joint data that replaces `joints`."""
        return joints

    def frame(self, frame: SkinFrame) -> SkinFrame:
        """Returns the faulty skin frame that replaces `frame`."""
        return frame

    def end(self) -> None:
        """Ends the fault. Called once, at the end of the fault."""
        return
