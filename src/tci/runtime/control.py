"""One period of a control loop, cut in two: `observe` reads the robot, `act` commands it.

All loops of TCI are built on `Control`: `run`, `Stepper`, the environment, and the checks of a new robot. It
has one thread and no queue. Missed periods are skipped and counted. The end of the `with` block, also after
an error, first brings the robot to rest.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from types import TracebackType
from typing import Self, cast

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.drivers.driver import Driver
from tci.errors import CommandError, FrameError
from tci.gate.gate import GateState
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Order, Perception, PlatformOrder, Reading
from tci.messages.clock import ROUNDING
from tci.reasons import Code, Reason
from tci.runtime.loop_report import LoopReport
from tci.runtime.moment import Moment, Tick
from tci.runtime.watchdogs import MISSED, Watchdog

PERSISTS = 0.1
"""If skin frames do not fit the robot's description for longer than this time [s], the gate stops the robot.
Single damaged frames do no harm."""
REST = 0.5
"""Longest time [s] that the end waits until the robot is at rest. With the accelerations in the descriptions,
robots come to rest in less."""
LET_GO = 0.1
"""Length [s] of the last part of `REST`, in which nothing is read any more. The gate then sets all torques to
zero, because its data is too old. Otherwise a joint in torque mode would keep its last torque."""
STILL = 1e-6
"""Commanded speed [rad/s] below which a joint is at rest: above rounding errors, far below any motion."""


class Control:
    """Reads a robot and commands it, one period after the other: `observe`, `act`, `observe`, `act` ...

    In a `with` block it is the only commander of the robot (`Driver.commanding`), and it leaves the robot at
    rest. Outside of one it writes as `Driver.write` does, and nobody brings the robot to rest: enough for
    a simulation, and for reading.
    """

    def __init__(
        self,
        driver: Driver,
        body: GenericBody | None = None,
        *,
        who: str = "a Control",
        watchdogs: Sequence[Watchdog] = (),
        sensed: Callable[[Reading], None] | None = None,
        see: Callable[[Tick], None] | None = None,
        report: LoopReport | None = None,
        write: bool = True,
    ) -> None:
        """Prepares to control the robot of `driver`.

        Args:
            driver: Open connection to the robot.
            body: Body that perceives and to which the orders are addressed. None: nothing is perceived, and
                orders are in the robot's own joints (`PlatformOrder`).
            who: Name for others that want to command the robot meanwhile.
            watchdogs: Asked in each period, after reading. A reason holds the robot; the last one is told.
            sensed: Called with each reading before it is processed.
            see: Called with each finished period that has a perception. `act` waits for it.
            report: Updated in each period.
            write: False to send nothing; the driver then need not be armed.
        """
        self.driver, self.body = driver, body
        self.report = report or LoopReport()
        self._who, self._watchdogs, self._sensed, self._see = who, watchdogs, sensed, see
        self._writes = write
        self._write: Callable[[SafeCommand], SafeCommand] | None = driver.write if write else None
        self._perceiver = None if body is None else Perceiver(body, keep_alive=driver.info.keep_alive)
        self._period = driver.period
        self._ticks: Iterator[float] | None = None
        self._start = 0.0
        self._before: float | None = None
        self._begun = 0.0
        self._misfit: float | None = None
        self._moment: Moment | None = None
        self._perception: Perception | None = None
        self._joints: JointReading | None = None
        self._sent: SafeCommand | None = None
        self._over = False
        self._commanding = ExitStack()

    def __enter__(self) -> Self:
        if self._writes:
            self._write = self._commanding.enter_context(self.driver.commanding(self._who))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._commanding:
            if self._over:
                return
            if error is None:
                self.finish()
            else:
                self.stop(f"{type(error).__name__}: {error}".removesuffix(": "), error)

    def periods(self, *, duration: float | None = None) -> Iterator[Moment]:
        """Yields what `observe` returns, from now on, until `duration` [s] or the recording is over. Call
        `act` for each, if something is to be sent."""
        self._begin(duration)
        while (moment := self.observe()) is not None:
            yield moment
        if duration is not None and self._before is not None:
            self._count(math.ceil(duration / self._period - ROUNDING) - self._period_of(self._before) - 1)

    def observe(self) -> Moment | None:
        """Waits for the next period, reads the robot and asks the watchdogs. None if the recording, or the
        duration of `periods`, is over.

        If no reading fits the robot's description for longer than `PERSISTS`, stops the gate. Raises the
        errors of the driver.
        """
        if self._ticks is None:
            self._begin(None)
            assert self._ticks is not None
        now = next(self._ticks, None)
        if now is None:
            return None
        missed = self._timing(now)
        self._begun = time.perf_counter()
        reading = self.driver.read()
        took = time.perf_counter() - self._begun
        if self._sensed is not None:
            self._sensed(reading)
        self._joints = reading.joints
        perception = misfit = None
        if self._perceiver is not None:
            try:
                perception = self._perceiver.step(reading, now)
                if met := self.driver.gate.met:
                    perception = replace(perception, met=met)
                self._perception = perception
                self._misfit = None
            except FrameError as error:
                misfit = error
                self.report.rejected += 1
                self._misfit = now if self._misfit is None else self._misfit
                if now - self._misfit > PERSISTS:
                    self.driver.gate.stop(error.reason)
        moment = self._moment = Moment(now, reading, perception, took, missed, misfit)
        for watchdog in self._watchdogs:
            if (reason := watchdog(moment)) is not None:
                self.driver.gate.hold(reason)
        held = None if perception is None else self.driver.gate.held(reading.joints, now)
        if perception is not None and held is not None:
            perception = self._perception = replace(perception, held=held)
            moment = self._moment = replace(moment, perception=perception)
        return moment

    def act(self, orders: Sequence[Order] = ()) -> SafeCommand:
        """Passes orders through the gate and sends what it makes of them, which is the result. Without
        orders, motions go on.

        Raises CommandError before the first `observe`, and the errors of the driver.
        """
        if self._moment is None:
            raise CommandError("act before the robot was read; valid: observe, then act")
        moment, joints = self._moment, self._moment.reading.joints
        platform, refused = cast("Sequence[PlatformOrder]", orders), list[Reason]()
        if self.body is not None:
            platform, refused = self.body.to_platform(orders, joints)
        contacts = None if moment.perception is None else moment.perception.contacts
        sent = self._sent = self.driver.gate.step(
            platform, joints, moment.now, refused=refused, contacts=contacts
        )
        if self._write is not None:
            self._write(sent)
        if self._see is not None and self._perception is not None:
            self._see(Tick(moment.now, moment.reading, self._perception, tuple(orders), sent))
        self.report.ticks += 1
        self.report.work.add(time.perf_counter() - self._begun)
        return sent

    def halt(self) -> None:
        """Calls the robot's own stop (`Driver.halt`). What was sent before needs no other end."""
        self.driver.halt()
        self._sent = None

    def finish(self) -> None:
        """Brings joints that still move to rest: holds the robot until they are at rest, and then ends the
        hold."""
        self._over = True
        gate = self.driver.gate
        if self._sent is None or not _moves(self._sent):
            return
        self.report.cut_short = self._writes and not self.driver.info.recorded
        ended = Reason(Code.RUN_ENDED, "the run has ended")
        self._rest(lambda: gate.hold(ended))
        for sent in self._last_writes():
            if sent.state is not GateState.HOLD:
                return

    def stop(self, reason: str, cause: BaseException) -> None:
        """Stops the gate and brings the robot to rest after the error `cause`. If that raises another error,
        adds a note about it to `cause`."""
        self._over = True
        self.driver.gate.stop(Reason(Code.PROGRAM_FAILED, reason))
        try:
            self._rest()
        except Exception as error:
            cause.add_note(f"and the robot could not be brought to rest: {error}")

    def _begin(self, duration: float | None) -> None:
        self._start, self._before = self.driver.clock.now(), None
        self._ticks = iter(self.driver.ticks(duration=duration, start=self._start))

    def _timing(self, now: float) -> int:
        """Counts the periods that were missed before this one, and returns their number."""
        if self._before is None:
            self._before = now
            # periods before the first tick do not count as missed
            self._start += self._period_of(now) * self._period
        missed = self._period_of(now) - self._period_of(self._before) - 1
        self._before = now
        late = (now - self._start + self._period * ROUNDING) % self._period
        self.report.lateness.add(max(0.0, late))
        return self._count(missed)

    def _count(self, missed: int) -> int:
        if missed <= 0:
            return 0
        self.report.overruns += 1
        self.report.missed += missed
        return missed

    def _period_of(self, now: float) -> int:
        """Number of the period that contains the time `now` [s]; the first is 0."""
        return int((now - self._start) / self._period + ROUNDING)

    def _rest(self, halt: Callable[[], None] | None = None) -> None:
        """Writes until the commanded speeds and torques of all joints are zero, but for at least four
        periods, so that a process that misses three commands still receives the fourth. Calls `halt`, if
        given, in each period.
        """
        for count, sent in enumerate(self._last_writes(halt), start=1):
            if count > MISSED and not _moves(sent):
                return

    def _last_writes(self, halt: Callable[[], None] | None = None) -> Iterator[SafeCommand]:
        """Runs the gate without orders and writes what it makes, once per period, for at most `REST`. Yields
        each command that was sent. Goes on after a failed write, since other parts of the robot may still
        receive commands. Raises the error of the last write if that one failed.
        """
        driver = self.driver
        failure: Exception | None = None
        if self._write is None or not driver.armed or driver.info.recorded or self._joints is None:
            return
        begin = driver.clock.now()
        for now in driver.ticks(duration=REST):
            contacts = None
            # if reading fails, the gate still stops joints in position mode, and ends torques
            with suppress(Exception):
                if now - begin < REST - LET_GO:
                    reading = driver.read()
                    self._joints = reading.joints
                    if self._perceiver is not None:  # who is met at the end is freed too
                        contacts = self._perceiver.step(reading, now).contacts
            if halt is not None:
                halt()
            try:
                sent, failure = self._write(driver.gate.step((), self._joints, now, contacts=contacts)), None
            except Exception as error:
                failure = error
            else:
                yield sent
        if failure is not None:
            raise failure


def _moves(sent: SafeCommand) -> bool:
    """True if anything moves or pushes."""
    return bool(np.any(np.abs(sent.velocity) >= STILL) or np.any(sent.torque))
