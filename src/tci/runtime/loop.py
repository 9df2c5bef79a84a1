"""The control loop.

Once per period of the driver, the loop reads the sensors, computes the perception, runs the capability,
checks the commands with the gate, and writes the checked command. Missed periods are skipped and counted. If
three or more periods in a row are missed, the gate holds the robot. When the loop ends, also after an error,
the loop first brings the robot to rest. After that, the loop raises the error of the capability, of an
observer or of a thread.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tci.body.generic_body import BodySettings, GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.capability import Capability
from tci.capabilities.orders import begin_of, step_of
from tci.drivers.driver import Driver
from tci.errors import CommandError, FrameError
from tci.gate.gate import GateState, SafeCommand
from tci.messages import JointReading, Order, Perception, Reading, SkinState
from tci.messages.clock import ROUNDING, MonotonicClock
from tci.reasons import Code, Reason
from tci.runtime.arguments import as_capability, as_driver, check_duration
from tci.runtime.loop_report import LoopReport
from tci.runtime.result import Account, RunResult
from tci.runtime.warm_up import WARM_UP, WarmUp
from tci.runtime.watchdogs import SkinWatchdog, frozen_garbage, implausible_force, interruptions

MISSED = 3
"""Least number of successive missed periods at which the gate holds the robot. Assumed: without real-time
priority, a few missed periods are normal."""
PERSISTS = 0.1
"""If skin frames do not fit the robot's description for longer than this time [s], the gate stops the robot.
Assumed: single damaged frames do no harm."""
REST = 0.5
"""Longest time [s] that the loop waits at the end of a run until the robot is at rest. Assumed: with the
accelerations in the descriptions, robots come to rest in less time."""
LET_GO = 0.1
"""Length [s] of the last part of the waiting time `REST` at the end of a run. In this part the loop reads no
sensor data. The gate then sets all torques to zero, because its data is too old. Otherwise a joint in torque
mode would keep its last torque."""
STILL = 1e-6
"""Commanded speed [rad/s] below which a joint counts as at rest. Assumed: larger than rounding errors, and
far smaller than the speed of any motion."""

Memory = TypeVar("Memory")


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """The data of one period of the loop."""

    now: float
    """Time [s] at the start of the period, on the driver's clock."""
    reading: Reading
    """Reading of the robot."""
    perception: Perception
    """Perception for the capability. If the skin frames of this reading do not fit the robot's description,
    this is the perception of the previous tick."""
    commands: tuple[Order, ...]
    """Orders that the capability returned in this tick."""
    sent: SafeCommand
    """Command that the gate returned and the driver sent."""

    @property
    def skin(self) -> SkinState:
        """Pressure on the whole skin, from which the contacts were computed."""
        assert self.perception.skin is not None  # a Perceiver always sets `skin`
        return self.perception.skin


def run(
    driver: Driver,
    capability: Capability[Memory],
    *,
    duration: float | None = None,
    observe: Callable[[Tick], None] | None = None,
    sensed: Callable[[Reading], None] | None = None,
    guard: Callable[[], Reason | None] | None = None,
    until: Callable[[Memory], bool] | None = None,
    report: LoopReport | None = None,
    write: bool = True,
    settings: BodySettings | None = None,
) -> RunResult[Memory]:
    """Runs a capability on a robot for `duration` [s], or until the user interrupts the run. Returns the
    result.

    The result contains the capability's last memory. `bool(result)` is False if the gate stopped the robot or
    refused every command. In these two cases `run` raises no exception, so that the caller gets the memory
    and the reasons. The logger `tci` (module `logging`) immediately logs every hold, every stop, and the
    first refusal and the first clamp of each kind.

    The loop calls `observe` with each finished tick, and `sensed` with each reading before the reading is
    processed. The loop waits for both functions, so both functions must return quickly. The loop calls
    `guard` in each period; `guard` (for example `heartbeat.Listener.fault`) returns a reason to hold the
    robot, or None. The loop updates `report` during the run. With `write=False` the loop sends no command,
    and the driver need not be armed. The loop calls `until` with the capability's memory after each tick, and
    ends the run when `until` returns True. `settings` are the settings of the generic body, such as those of
    the skin's conditioning; None for the default settings.

    At the end of every run, also after an error, the loop interrupts unfinished motions and brings the robot
    to rest. The loop waits at most half a second (`REST`) until the robot is at rest. If SIGINT or SIGTERM
    ended the run, `run` then raises KeyboardInterrupt or SystemExit.

    Before the robot moves, raises TciError for an invalid duration or argument, CommandError if the gate
    refuses the capability's first commands, and DriverError if another process commands the robot. After the
    robot has come to rest, raises CommandError if a step of the capability did not return commands and
    memory. At this time, `run` also raises errors of the driver, of the capability, of an observer or of a
    thread.
    """
    check_duration(duration)
    driver, capability = as_driver(driver), as_capability(capability)
    body = GenericBody(driver.robot, settings or BodySettings())
    loop = _Loop(driver, capability, body, observe, guard, report or LoopReport(), write)
    loop.sensed = sensed
    with driver.commanding() if write else nullcontext(), interruptions() as interruption, frozen_garbage():
        try:
            start = driver.clock.now()
            loop.begin(start)
            for now in driver.ticks(duration=duration, start=start):
                loop.tick(now)
                interruption.raise_it()
                if until is not None and until(loop.memory):
                    break
                loop.warm_up(now)
            else:
                loop.end(duration)
            loop.finish()
            interruption.raise_it()
            loop.report.ended = "done"
            return loop.account.result(loop.memory, loop.report)
        except BaseException as error:
            interruption.rests = True
            where = f" in thread {interruption.thread}" if error is interruption.failure else ""
            name = "Ctrl-C" if isinstance(error, KeyboardInterrupt) else type(error).__name__
            loop.report.ended = f"{name}{where}: {error}".removesuffix(": ")
            loop.stop(loop.report.ended, error)
            raise


class _Loop(Generic[Memory]):
    """State of one run: the capability's memory and the timing of the periods."""

    def __init__(
        self,
        driver: Driver,
        capability: Capability[Memory],
        body: GenericBody,
        observe: Callable[[Tick], None] | None,
        guard: Callable[[], Reason | None] | None,
        report: LoopReport,
        write: bool,
    ) -> None:
        self.driver = driver
        self._period = driver.period
        self.capability = capability
        self.observe = observe
        self.guard = guard
        self.sensed: Callable[[Reading], None] | None = None
        self.report = report
        self.write = write
        self.body = body
        self.perceiver = Perceiver(self.body, keep_alive=driver.info.keep_alive)
        self.memory = capability.init(self.body)
        self.account = Account(driver)
        self._begun = False
        self._before: float | None = None
        self._start: float
        self._silence = SkinWatchdog(
            driver.robot, stale_after=driver.gate.stale_after, keep_alive=driver.info.keep_alive
        )
        self._misfit: float | None = None
        self._perception: Perception | None = None
        self._joints: JointReading | None = None
        self._sent: SafeCommand | None = None
        # a simulated clock waits for the loop, so saved time at the next command would be no gain
        real = isinstance(driver.clock, MonotonicClock)
        self._warm_up = WarmUp(self.body, driver.gate) if real and write else None

    def begin(self, now: float) -> None:
        """Sets the start of the first period to the time `now` [s]."""
        self._start = now

    def tick(self, now: float) -> None:
        """Executes one control period. `now` [s] is the present time on the driver's clock."""
        begin = time.perf_counter()
        gate = self.driver.gate
        gate.hold(self._timing(now) or (self.guard() if self.guard else None))
        reading = self.driver.read()
        if self.sensed is not None:
            self.sensed(reading)
        self._joints = reading.joints
        gate.hold(self._silence.fault(reading, now))
        seen = self._perceive(reading, now)
        commands: tuple[Order, ...] = ()
        opening = False
        if seen is not None:
            gate.hold(implausible_force(seen.contacts))
            if not self._begun:
                commands = begin_of(self.capability, seen, self.body)
                opening = bool(commands)
            if not opening:
                commands, self.memory = step_of(self.capability, self.memory, seen, self.body)
            if fault := self.capability.fault(seen, self.body):
                gate.stop(fault)
        orders, refused = self.body.to_platform(commands, reading.joints)
        sent = self._sent = gate.step(orders, reading.joints, now, refused=refused)
        if self.write:
            self.driver.write(sent)
        self.account.add(seen, reading.joints.position, sent, opening=opening)
        if opening and self.write and sent.refusals:
            name = type(self.capability).__name__
            raise CommandError(f"{name} can't begin: {'; '.join(map(str, sent.refusals))}")
        self._begun |= seen is not None
        if self.observe is not None and self._perception is not None:
            self.observe(Tick(now, reading, self._perception, commands, sent))
        self.report.ticks += 1
        self.report.work.add(time.perf_counter() - begin)

    def warm_up(self, now: float) -> None:
        """Executes the code of a command without effect, so that the next real command takes less time. Does
        so once in `WARM_UP` periods, and only if half of the period that began at `now` [s] is left."""
        if self._warm_up is None or self.report.ticks % WARM_UP:
            return
        if self.driver.clock.now() - now < self._period / 2:
            self._warm_up.step()

    def end(self, duration: float | None) -> None:
        """Adds the periods that were missed between the last tick and the end of the run to the report. The
        run lasts `duration` [s]; with None, nothing is added."""
        if duration is None or self._before is None:
            return
        missed = math.ceil(duration / self._period - ROUNDING) - self._period_of(self._before) - 1
        if missed > 0:
            self.report.overruns += 1
            self.report.missed += missed

    def _timing(self, now: float) -> Reason | None:
        """Adds the periods that were missed since the previous tick to the report. Returns a reason to hold
        the robot if `MISSED` (3) or more periods were missed, otherwise None. `now` [s] is the present time.
        """
        period = self._period
        if self._before is None:
            self._before = now
            # periods before the first tick do not count as missed
            self._start += self._period_of(now) * period
        missed = self._period_of(now) - self._period_of(self._before)
        self._before = now
        self.report.lateness.add(max(0.0, (now - self._start + period * ROUNDING) % period))
        if missed <= 1:
            return None
        self.report.overruns += 1
        self.report.missed += missed - 1
        if missed <= MISSED:
            return None
        return Reason(Code.PERIODS_MISSED, f"the loop missed {missed - 1} periods")

    def _period_of(self, now: float) -> int:
        """Returns the number of the period that contains the time `now` [s].

        The first period has number 0.
        """
        return int((now - self._start) / self._period + ROUNDING)

    def _perceive(self, reading: Reading, now: float) -> Perception | None:
        """Returns the perception of a reading; None if the skin frames of the reading do not fit the robot's
        description. If no reading fits for longer than `PERSISTS` (0.1 s), stops the gate. `now` [s] is the
        present time.
        """
        try:
            self._perception = self.perceiver.step(reading, now)
        except FrameError as error:
            self.report.rejected += 1
            self._misfit = now if self._misfit is None else self._misfit
            if now - self._misfit > PERSISTS:
                self.driver.gate.stop(error.reason)
            return None
        self._misfit = None
        return self._perception

    def finish(self) -> None:
        """Brings joints that still move at the end of a run to rest: holds the robot until they are at rest,
        and then ends the hold.
        """
        if self._sent is None or not _moves(self._sent):
            return
        gate = self.driver.gate
        self.report.cut_short = self.write and not self.driver.info.recorded
        ended = Reason(Code.RUN_ENDED, "the run has ended")
        self._rest(lambda: gate.hold(ended))
        for sent in self._writes():
            if sent.state is not GateState.HOLD:
                return

    def stop(self, reason: str, cause: BaseException) -> None:
        """Stops the gate and brings the robot to rest after the error `cause`. `reason` is the text that the
        gate reports. If bringing the robot to rest raises another error, adds a note about it to `cause`.
        """
        self.driver.gate.stop(Reason(Code.PROGRAM_FAILED, reason))
        try:
            self._rest()
        except Exception as error:
            cause.add_note(f"and the robot could not be brought to rest: {error}")

    def _rest(self, halt: Callable[[], None] | None = None) -> None:
        """Writes commands until the commanded speeds and torques of all joints are zero, but for at least
        four periods. So a process that misses three commands still receives the fourth. Calls `halt`, if
        given, in each period.
        """
        for count, sent in enumerate(self._writes(halt), start=1):
            if count > MISSED and not _moves(sent):
                return

    def _writes(self, halt: Callable[[], None] | None = None) -> Iterator[SafeCommand]:
        """Runs the gate without new orders and writes the resulting command, once per period, for at most
        `REST` (0.5 s). Calls `halt`, if given, in each period. Yields each command that was sent. Continues
        after a failed write, since other parts of the robot may still receive commands. Raises the error of
        the last write if the last write failed.
        """
        driver = self.driver
        failure: Exception | None = None
        if not self.write or not driver.armed or driver.info.recorded or self._joints is None:
            return
        begin = driver.clock.now()
        for now in driver.ticks(duration=REST):
            # if reading fails, the gate still stops joints in position mode, and ends torques
            with suppress(Exception):
                if now - begin < REST - LET_GO:
                    self._joints = driver.read().joints
            if halt is not None:
                halt()
            try:
                sent, failure = driver.write(driver.gate.step((), self._joints, now)), None
            except Exception as error:
                failure = error
            else:
                yield sent
        if failure is not None:
            raise failure


def _moves(sent: SafeCommand) -> bool:
    """Returns True if the command that was sent moves a joint: if it contains a speed of at least `STILL`
    (1e-6 rad/s), or a torque that is not zero."""
    return bool(np.any(np.abs(sent.velocity) >= STILL) or np.any(sent.torque))
