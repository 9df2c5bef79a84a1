"""Fault injection: a driver that wraps another driver and corrupts the wrapped driver's data from a given
time on. Most faults change only the readings that the loop receives. The wrapped driver and its gate do not
change. Users can test their own behaviours with the faults that TCI's tests use (docs/reliability.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import CommandError, UnknownNameError
from tci.lab.faults.fault_list import FAULTS
from tci.lab.faults.injectors import INJECTORS, Injector
from tci.messages import Reading, SkinFrame
from tci.messages.frames import read_only


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """One fault with start time and duration."""

    name: str
    """Name of the fault injector."""
    at: float
    """Time [s] from the first reading to the start of the fault."""
    lasts: float = float("inf")
    """Duration [s] of the fault."""

    def __str__(self) -> str:
        fault = FAULTS[INJECTORS[self.name].number]
        return f"{self.name} (fault {fault.number}: {fault.fault})"


def parse_fault(text: str) -> FaultPlan:
    """Parses a fault written as NAME@TIME or NAME@TIME:DURATION, with TIME and DURATION in [s].

    Raises UnknownNameError if the fault is unknown, and CommandError if a time is invalid.
    """
    name, _, times = text.partition("@")
    at, _, lasts = times.partition(":")
    if name not in INJECTORS:
        raise UnknownNameError("fault", name, INJECTORS)
    try:
        plan = FaultPlan(name, float(at), float(lasts) if lasts else float("inf"))
    except ValueError:
        plan = FaultPlan(name, float("nan"))
    if not (0.0 <= plan.at < float("inf") and plan.lasts > 0.0):
        raise CommandError(
            f"fault {text!r}; valid: NAME@TIME or NAME@TIME:DURATION, in seconds, as in {name}@0.32"
        )
    return plan


class FaultInjector(DriverWrapper):
    """A driver that injects faults into the data of the driver `inner`. The fault injector uses the gate,
    clock and lease of `inner`."""

    def __init__(self, inner: Driver, plans: Sequence[FaultPlan], *, flicker: float = 0.0) -> None:
        """Wraps `inner`. `flicker` [counts] is the standard deviation of noise that is added to each raw
        value of the skin. Real sensors have noise, and without noise a dead taxel can't be distinguished from
        a taxel at rest."""
        super().__init__(inner)
        self._flicker, self._random = flicker, np.random.default_rng(0)
        self._frames: dict[str, SkinFrame] = {}
        self.begun: list[FaultPlan] = []
        """Faults that have started, the earliest first."""
        self._waiting = sorted(plans, key=lambda plan: plan.at)
        self._active: list[tuple[FaultPlan, Injector]] = []
        self._start: float | None = None

    def inject(self, plan: FaultPlan) -> None:
        """Adds a fault that starts `plan.at` [s] from now. Call this method in the thread of the loop."""
        since = 0.0 if self._start is None else self.clock.now() - self._start
        self._waiting.append(replace(plan, at=plan.at + since))
        self._waiting.sort(key=lambda waiting: waiting.at)

    @property
    def active(self) -> tuple[FaultPlan, ...]:
        """Faults that have started and not ended."""
        return tuple(plan for plan, _ in self._active)

    def _receive(self) -> Reading:
        reading = self.inner.read()
        if self._flicker:
            reading = replace(reading, skin=tuple(map(self._flickering, reading.skin)))
        now = self.clock.now()
        if self._start is None:
            self._start = now
        since = now - self._start
        while self._waiting and self._waiting[0].at <= since + 1e-9:
            plan = self._waiting.pop(0)
            self._active.append((plan, INJECTORS[plan.name](self.inner, reading)))
            self.begun.append(plan)
        for plan, injector in list(self._active):
            if since >= plan.at + plan.lasts:
                injector.end()
                self._active.remove((plan, injector))
        frozen = Reading(replace(reading.joints), reading.skin)
        for _, injector in self._active:
            frozen = injector.read(frozen)
        return frozen

    def _flickering(self, frame: SkinFrame) -> SkinFrame:
        """Returns the frame with noise in its raw values. If the frame is read again, the noise is equal.
        Frames of switches get no noise."""
        sensor = self.robot.patch(frame.patch).sensor
        if sensor.switch:
            return frame
        last = self._frames.get(frame.patch)
        if last is None or last.sequence != frame.sequence:
            noise = self._flicker * self._random.standard_normal(len(frame.values))
            values = np.clip(np.rint(frame.values.astype(float) + noise), sensor.lowest, sensor.highest)
            last = self._frames[frame.patch] = replace(frame, values=read_only(values))
        return last

    def _close(self) -> None:
        for _, injector in self._active:
            injector.end()
        self._active.clear()
        self.inner.close()
