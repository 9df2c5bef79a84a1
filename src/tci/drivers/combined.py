"""Combines separate drivers for joints and skin into one driver, for example for a NAO whose joints are
reached over NAOqi and whose skin is reached over YARP."""

from __future__ import annotations

from collections.abc import Sequence

from tci.drivers.diagnosis import Finding
from tci.drivers.driver import Driver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import DriverError
from tci.messages import Reading, SkinFrame
from tci.messages.clock import MonotonicClock


class CombinedDriver(DriverWrapper):
    """A driver that combines one driver for the joints with several drivers for the skin. The combined driver
    uses the gate, the clock and the lease of the joints' driver."""

    def __init__(self, joints: Driver, skins: Sequence[Driver]) -> None:
        """Combines the drivers. Joints are read from `joints`, and each patch of skin from the first driver
        in `skins` that has sent a frame of this patch. Closing the combined driver also closes `joints` and
        `skins`. Raises DriverError if one of these drivers does not use this machine's own clock.
        """
        for driver in (joints, *skins):
            if not isinstance(driver.clock, MonotonicClock):
                raise DriverError(
                    f"{type(driver).__name__} has a clock of its own, so it can't be combined with "
                    "others; valid: drivers of real robots"
                )
        sparse = [driver.info.keep_alive for driver in skins if driver.info.keep_alive]
        super().__init__(joints, keep_alive=max(sparse, default=None))
        self.skins = tuple(skins)

    def diagnose(self) -> tuple[Finding, ...]:
        return tuple(finding for driver in (self.inner, *self.skins) for finding in driver.diagnose())

    def _receive(self) -> Reading:
        reading = self.inner.read()
        frames: dict[str, SkinFrame] = {}
        for driver in self.skins:
            for frame in driver.read().skin:
                frames.setdefault(frame.patch, frame)
        return Reading(reading.joints, tuple(frames.values()))

    def _close(self) -> None:
        for driver in (self.inner, *self.skins):
            driver.close()
