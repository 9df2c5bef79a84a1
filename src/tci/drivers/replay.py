"""`replay:FILE`: driver that returns the readings of a recording, without hardware. Loop, behaviour and gate
work as with a robot. If behaviour and settings are those of the recording, every decision of the gate equals
the recorded decision bit for bit. With other settings, the replay shows what the gate decides with these
settings on the recorded sensor data."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator

from tci.drivers.driver import Driver
from tci.drivers.info import STREAMS, DriverInfo
from tci.errors import DriverError
from tci.gate.gate import SafeCommand
from tci.messages import Reading
from tci.messages.clock import SteppedClock
from tci.recording.importing import FROM_FILE
from tci.recording.recorder import versions
from tci.recording.recording import RecordedTick, Recording
from tci.recording.schemas import same_decision
from tci.robot.like import RobotLike, as_robot


def changed_versions(then: str) -> list[str]:
    """Returns one text for each software whose version in a recording differs from the installed version.

    `then` contains the recording's versions as JSON. If `then` is not valid JSON, the list is empty.
    """
    try:
        known = json.loads(then)
    except ValueError:
        return []
    here = versions()
    known = known if isinstance(known, dict) else {}
    return [f"{name} {str(old)[:20]}, here {here.get(name, 'none')}"
            for name, old in known.items() if name in here and here[name] != old]  # fmt: skip


class ReplayClock(SteppedClock):
    """A clock with the recorded times."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def sleep_until(self, stamp: float) -> None:
        """Returns immediately, since the recording determines the time."""


class ReplayDriver(Driver):
    """A driver that replays a recording instead of reading a robot."""

    def __init__(self, robot: RobotLike, address: str = "", *, arm: bool = True) -> None:
        """Opens the recording in the file `address`.

        Raises DriverError if the file does not exist, or if the recording contains another robot or another
        version of the robot's description. Raises RecordingError if the file is no recording.
        """
        robot = as_robot(robot)
        if not address:
            raise DriverError("a replay needs a recording; valid: replay:FILE")
        try:
            self.recording = Recording(address)
        except OSError as error:
            raise DriverError(f"the recording {address!r} can't be read: {error.strerror}") from error
        about = self.recording.about
        if (about.get("robot"), about.get("description_sha256")) != (robot.name, robot.digest):
            raise DriverError(
                f"{address} was recorded from {about.get('robot', '')[:40]!r}, description "
                f"{about.get('description_sha256', '')[:12]}; "
                f"this is {robot.name!r}, description {robot.digest[:12]}; valid: the recorded one"
            )
        self._clock = ReplayClock()
        # data that was imported from a file of arrays came over no middleware
        middleware = about.get("middleware", "")
        super().__init__(
            DriverInfo.of(
                robot,
                "sim" if middleware == FROM_FILE else middleware,
                clock=self._clock,
                armed=arm,
                lease_name=f"replay:{robot.name}:{os.getpid()}:{id(self)}",
                period=self.recording.period or None,
                keep_alive=self.recording.keep_alive,
                about={key: about[key] for key in ("seed", "step_s") if key in about},
                streams=about.get(STREAMS, str(middleware == "sim").lower()) == "true",
                recorded=True,
            )
        )
        self.compared = 0
        """Number of decisions that were compared with the recorded decisions."""
        self.different: list[float] = []
        """Times [s] of decisions that differ from the recorded decision in the gate's state, in a control
        mode, in the code of a reason, or in a number."""
        self.changed = changed_versions(about.get("versions", ""))
        """Software whose installed version differs from the version in the recording, e.g. `numpy 2.4.6, here
        2.5.0`.

        Because of these differences, numbers in decisions may differ from the recorded numbers in the last
        bits.
        """
        self._ticks = self.recording.ticks()
        self._tick: RecordedTick | None = None
        if (first := next(self.recording.ticks(), None)) is not None:
            self._clock.time = first.now

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        """Yields the recorded times [s], without waiting, until the file ends or `duration` [s] is over.

        Ignores `start`.
        """
        del start
        begun: float | None = None
        for tick in self._ticks:
            self._tick, self._clock.time = tick, tick.now
            begun = tick.now if begun is None else begun
            if duration is not None and tick.now - begun >= duration - 1e-9:
                return
            yield tick.now

    def _receive(self) -> Reading:
        if self._tick is None:
            self._tick = next(self._ticks, None)
            if self._tick is None:
                raise DriverError(f"{self.recording.path} contains no complete period")
            self._clock.time = self._tick.now
        return self._tick.reading

    def _send(self, safe: SafeCommand) -> None:
        recorded = self._tick.decision if self._tick is not None else None
        if recorded is not None:
            self.compared += 1
            if not same_decision(safe, recorded):
                self.different.append(safe.stamp)

    def _close(self) -> None:
        self._ticks = iter(())
