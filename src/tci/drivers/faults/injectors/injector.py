"""The base class of what can be made to fail. Each works on any driver, unless it says otherwise."""

from __future__ import annotations

from abc import ABC
from typing import ClassVar

from tci.drivers.driver import Driver
from tci.messages import JointReading, Reading, SkinFrame


class Injector(ABC):
    """One fault while it lasts."""

    number: ClassVar[int]
    """Its number in the catalogue."""
    says: ClassVar[str]
    """What happens, for `tci fault list`."""
    shows_after: ClassVar[float] = 0.0
    """How long [s] it may take until anybody can know."""

    def __init__(self, driver: Driver, first: Reading) -> None:
        """The fault begins: `first` is the last sound reading."""
        self.driver = driver
        self.first = first
        self.begin()

    def begin(self) -> None:
        """What is done once, at the beginning."""
        return

    def read(self, reading: Reading) -> Reading:
        """The reading that the loop gets instead."""
        return Reading(self.joints(reading.joints), tuple(map(self.frame, reading.skin)))

    def joints(self, joints: JointReading) -> JointReading:
        """The joints that the loop gets instead."""
        return joints

    def frame(self, frame: SkinFrame) -> SkinFrame:
        """The skin frame that the loop gets instead."""
        return frame

    def end(self) -> None:
        """The fault is over."""
        return
