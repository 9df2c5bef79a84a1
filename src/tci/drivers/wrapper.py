"""Base class of drivers that wrap another driver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from tci.drivers.diagnosis import Finding
from tci.drivers.driver import Driver, NativePart
from tci.drivers.lease import Lease
from tci.gate.gate import SafeCommand
from tci.messages import Reading


class DriverWrapper(Driver):
    """A driver that wraps the driver `inner`. Every method calls the method of `inner` with the same name.

    Subclasses override the methods that they change.
    """

    def __init__(self, inner: Driver, **changed: Any) -> None:
        """Wraps `inner`; `changed` contains the fields of `DriverInfo` whose values differ from those of
        `inner`."""
        super().__init__(replace(inner.info, **changed))
        self.inner, self._baton = inner, inner._baton

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        return self.inner.ticks(duration=duration, start=start)

    def diagnose(self) -> tuple[Finding, ...]:
        return self.inner.diagnose()

    def native(self, robot_part: str) -> NativePart:
        return self.inner.native(robot_part)

    def _receive(self) -> Reading:
        return self.inner.read()

    def _send(self, safe: SafeCommand) -> None:
        self.inner._send(safe)

    def _halt(self) -> None:
        self.inner._halt()

    def _close(self) -> None:
        self.inner.close()

    def _kept_lease(self) -> Lease | None:
        return super()._kept_lease() or self.inner._kept_lease()
