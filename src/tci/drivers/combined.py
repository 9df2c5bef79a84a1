"""Joints one way, skin another: a NAO's joints over NAOqi, its skin over YARP, in one connection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tci.clock import MonotonicClock
from tci.drivers.diagnosis import Finding
from tci.drivers.driver import Driver
from tci.errors import DriverError
from tci.gate.gate import SafeCommand
from tci.messages import Reading, SkinFrame


class CombinedDriver(Driver):
    """One driver for the joints and others for the skin. Gate, clock and lease are those of the joints'
    driver."""

    def __init__(self, joints: Driver, skins: Sequence[Driver]) -> None:
        """Take the joints from `joints`, each patch from the first of `skins` that has sent it.

        All drivers are closed with this one. Raises DriverError when their clocks are not this machine's own.
        """
        self.joints, self.skins = joints, tuple(skins)
        for driver in (joints, *skins):
            if not isinstance(driver.clock, MonotonicClock):
                raise DriverError(
                    f"{type(driver).__name__} has a time of its own, so it can't be joined to others"
                )
        self.robot, self.clock, self.armed = joints.robot, joints.clock, joints.armed
        self.period, self.gate, self.lease_name = joints.period, joints.gate, joints.lease_name
        self.keep_alive = max((driver.keep_alive for driver in skins if driver.keep_alive), default=None)
        self.about, self.recorded = joints.about, joints.recorded
        self._open = True

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        return self.joints.ticks(duration=duration, start=start)

    def diagnose(self) -> tuple[Finding, ...]:
        return tuple(finding for driver in (self.joints, *self.skins) for finding in driver.diagnose())

    def _receive(self) -> Reading:
        reading = self.joints.read()
        frames: dict[str, SkinFrame] = {}
        for driver in self.skins:
            for frame in driver.read().skin:
                frames.setdefault(frame.patch, frame)
        return Reading(reading.joints, tuple(frames.values()))

    def _send(self, safe: SafeCommand) -> None:
        self.joints._send(safe)

    def _halt(self) -> None:
        self.joints._halt()

    def _close(self) -> None:
        for driver in (self.joints, *self.skins):
            driver.close()
