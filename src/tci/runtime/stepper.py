"""`Stepper`: the control loop for callers with a pace of their own: policies, viewers, notebooks."""

from __future__ import annotations

import logging
import math
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import FrameType, TracebackType
from typing import Protocol, Self

from tci.body.generic_body import BodySettings, GenericBody
from tci.capabilities.orders import as_orders
from tci.drivers.driver import Driver
from tci.errors import DriverError, TciError
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception
from tci.messages.clock import ROUNDING, SteppedClock
from tci.reasons import Code, Reason
from tci.runtime.arguments import as_driver
from tci.runtime.control import REST, Control
from tci.runtime.loop_report import LoopReport
from tci.runtime.moment import Moment, Tick
from tci.runtime.result import Account, RunResult
from tci.runtime.watchdogs import attentive, frozen_garbage, interruptions, usual_watchdogs

PATIENCE = 0.5
"""Least default of `patience` [s]: does not hold a policy that takes two steps per second, and stops a robot
whose program hangs before a person would."""
KEPT = 1.0
"""Age [s] up to which perceptions wait for a caller who is late."""
STUCK = 1.0
"""Time [s] after which a call gives up, if no reading fits the robot or the worker does not answer."""
_log = logging.getLogger("tci")


class Stepper:
    """Steps a robot at the caller's pace: `observe`, decide, `act`, `observe`, ...

    Where time waits for the caller (a simulation, a recording), `observe` runs the periods in the caller's
    thread, so results are equal bit for bit however slow the caller is. Where the clock runs by itself,
    a worker thread keeps gate, lease, watchdogs and observers going; if the caller stays away for longer than
    `patience`, it holds the robot. Velocities and torques expire after 0.1 s as everywhere.

    From its creation to `close`, which brings the robot to rest, the stepper is the only commander of its
    driver. Use it in a `with` block, from one thread at a time.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        period: float | None = None,
        patience: float | None = None,
        settings: BodySettings | None = None,
        see: Callable[[Tick], None] | None = None,
        guard: Callable[[], Reason | None] | None = None,
        report: LoopReport | None = None,
        write: bool = True,
    ) -> None:
        """Begins to control the robot.

        Args:
            driver: Open and armed connection to the robot.
            period: Time [s] from one perception to the next that `observe` returns, rounded up to whole
                periods of the driver. None: one period of the driver.
            patience: Time [s] without `act` after which the robot holds, until `act` is called again. None:
                0.5 s, or twice `period` if that is longer.
            settings: Settings of the generic body. None: the default.
            see: Called with each period of the driver, in the thread that runs it, for example to record it.
            guard: As in `run`.
            report: Updated in each period. None: a new one.
            write: False to send nothing; the driver need not be armed.

        Raises TciError for an invalid time, and DriverError if somebody else commands the robot.
        """
        self.driver = as_driver(driver, "Stepper")
        period = driver.period if period is None else period
        if not 0.0 < period < math.inf:
            raise TciError(f"Stepper: period {period} s; valid: above 0 and finite, or None")
        count = max(1, math.ceil(period / driver.period - ROUNDING))
        patience = max(PATIENCE, 2.0 * period) if patience is None else patience
        if not count * driver.period <= patience < math.inf:
            raise TciError(f"Stepper: patience {patience} s; valid: at least the period, and finite")
        self.body = GenericBody(driver.robot, settings or BodySettings())
        """The body of the robot, for everything that depends on it."""
        self.report = report or LoopReport()
        self.missed: tuple[Perception, ...] = ()
        """Perceptions between the last two that `observe` returned, at most those of the last second, oldest
        first. Each skin frame is in one of them or in those that `observe` returned."""
        watchdogs = usual_watchdogs(driver)
        if guard is not None:
            watchdogs = (lambda moment: guard(), *watchdogs)
        control = Control(
            driver, self.body, who="a Stepper", watchdogs=watchdogs, see=see, report=self.report, write=write
        )
        self._periods = _Periods(control, patience if write else math.inf)
        self._closed = False
        stepped = isinstance(driver.clock, SteppedClock)
        self._engine: _Engine = (_InTurn if stepped else _Worker)(self._periods, count)
        self._terminated = _exit_when_terminated()

    @property
    def lost(self) -> int:
        """Number of perceptions that were older than a second before the caller came for them."""
        return self._periods.lost

    def observe(self) -> Perception:
        """The newest perception, at least `period` after the previous one; waits for it.

        Raises FrameError if for a second no reading fits the robot, DriverError at the end of a recording or
        after `close`, and everything that ended the worker: errors of the driver, of `see` or of a thread.
        """
        self._check()
        found = self._engine.observe()
        self.missed = tuple(found[:-1])
        return found[-1]

    def act(self, orders: Order | Iterable[Order] = ()) -> SafeCommand:
        """Gives orders, in the next period of the driver, and returns what the gate sent in it: its
        `refusals` tell which orders were refused, and `reason` why the robot holds. Without orders, motions
        go on.

        Raises CommandError for something that is no order, and the errors of `observe`.
        """
        self._check()
        return self._engine.act(as_orders(orders, "act"))

    def result(self) -> RunResult[None]:
        """What happened so far, in a few lines, as after `run`."""
        return self._periods.account.result(None, self.report)

    def close(self) -> None:
        """Brings the robot to rest, and lets others command it. A second call has no effect. Raises the error
        that ended the worker, if no call has raised it, and DriverError if the worker hangs."""
        self._close(None)

    def _close(self, error: BaseException | None) -> None:
        if self._closed:
            return
        self._closed = True
        self.report.ended = "done" if error is None else f"{type(error).__name__}: {error}"
        try:
            self._engine.close(error)
        finally:  # a second signal must not end the program before the robot is at rest
            if self._terminated:
                _die_when_terminated()

    def _check(self) -> None:
        if self._closed:
            raise DriverError("this Stepper is closed; valid: a new one")
        self._periods.caller = threading.current_thread()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close(error)


class _Periods:
    """The periods of a control, with what waits for the caller."""

    def __init__(self, control: Control, patience: float) -> None:
        self.control = control
        self.robot = control.driver.robot.name
        self.period = control.driver.period
        self.account = Account(control.driver)
        self.lost = 0
        self.seen: deque[Perception] = deque()
        """Perceptions that the caller has not taken."""
        self.taken = -math.inf
        """Stamp [s] of the latest perception that the caller took."""
        self.moment: Moment | None = None
        self.caller = threading.current_thread()
        self._patience = patience
        self._heard: float | None = None

    def note(self, moment: Moment) -> None:
        self.moment = moment
        if moment.perception is not None:
            self.seen.append(moment.perception)
            while self.seen[0].stamp < moment.now - KEPT:
                self.seen.popleft()
                self.lost += 1

    def take(self) -> list[Perception]:
        found = [*self.seen]
        self.seen.clear()
        self.taken = found[-1].stamp
        return found

    def act(self, moment: Moment, orders: tuple[Order, ...] | None) -> SafeCommand:
        """`orders` is None if the caller gave none."""
        if orders is not None or self._heard is None:
            self._heard = moment.now
        else:
            self.control.driver.gate.hold(self._silence(moment.now - self._heard))
        sent = self.control.act(orders or ())
        self.account.add(moment.perception, moment.reading.joints.position, sent, opening=False)
        return sent

    def _silence(self, silent: float) -> Reason | None:
        if self._patience < math.inf and not self.caller.is_alive():
            return Reason(Code.CALLER_SILENT, f"caller silent: its thread {self.caller.name} has ended")
        if silent <= self._patience:
            return None
        return Reason(Code.CALLER_SILENT, f"caller silent for {silent:.2f} s")


class _Engine(Protocol):
    """Runs the periods of a stepper."""

    def observe(self) -> list[Perception]:
        """The perceptions since the last call; waits until the newest is a period of the stepper later."""

    def act(self, orders: tuple[Order, ...]) -> SafeCommand: ...

    def close(self, error: BaseException | None) -> None: ...


class _InTurn:
    """Runs the periods in the caller's thread, where time waits for the caller."""

    def __init__(self, periods: _Periods, count: int) -> None:
        self._periods, self._count = periods, count
        self._since = count - 1
        self._due: Moment | None = None
        periods.control.__enter__()

    def observe(self) -> list[Perception]:
        periods, begin = self._periods, self._periods.control.driver.clock.now()
        while self._since < self._count or not periods.seen:
            moment = self._advance()
            if moment.now - begin > STUCK + self._count * periods.period:
                moment.perceived()
        self._since = 0
        return periods.take()

    def act(self, orders: tuple[Order, ...]) -> SafeCommand:
        moment = self._due or self._advance()
        self._due = None
        return self._periods.act(moment, orders)

    def close(self, error: BaseException | None) -> None:
        self._periods.control.__exit__(None, error, None)

    def _advance(self) -> Moment:
        if self._due is not None:
            self._periods.act(self._due, None)
        self._due = self._periods.control.observe()
        if self._due is None:
            raise DriverError(f"the recording of {self._periods.robot} is over")
        self._periods.note(self._due)
        self._since += 1
        return self._due


@dataclass(slots=True, eq=False)
class _Request:
    orders: tuple[Order, ...]
    sent: SafeCommand | None = None


class _Worker:
    """Runs the periods in a thread, where the clock runs by itself.

    A thread goes on when its caller is late or dead, so `_Periods.act` holds the robot when the caller is
    silent, and the thread ends when the program does. It stands still beside a call that keeps the
    interpreter's lock; the watchdog of missed periods then holds the robot.
    """

    def __init__(self, periods: _Periods, count: int) -> None:
        self._periods = periods
        self._wait, self._apart = STUCK + count * periods.period, (count - 0.5) * periods.period
        self._changed = threading.Condition()
        self._request: _Request | None = None
        self._begun = self._closing = False
        self._cause: BaseException | None = None
        self._failure: BaseException | None = None
        # no daemon: Python waits for it, so that the robot is at rest when the program has ended
        self._thread = threading.Thread(target=self._work, name=f"stepper of {periods.robot}")
        self._thread.start()
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._begun or self._closing)
        except BaseException:
            self._closing = True
            raise
        if self._failure is not None:
            raise self._failure

    def observe(self) -> list[Perception]:
        periods = self._periods
        with self._changed:
            self._wait_for(self._is_due)
            return periods.take()

    def _is_due(self) -> bool:
        seen = self._periods.seen
        return bool(seen) and seen[-1].stamp - self._periods.taken >= self._apart

    def act(self, orders: tuple[Order, ...]) -> SafeCommand:
        request = _Request(orders)
        with self._changed:
            self._request = request
            self._wait_for(lambda: request.sent is not None)
        assert request.sent is not None
        return request.sent

    def close(self, error: BaseException | None) -> None:
        with self._changed:
            self._cause, self._closing = error, True
        self._thread.join(longest := 2.0 * REST + STUCK)
        if self._thread.is_alive():
            words = (
                f"the loop of {self._periods.robot} has not ended within {longest:.1f} s, so the robot may "
                "not be at rest; valid: the robot's own stop, then an end of this program"
            )
            if error is None:
                raise DriverError(words)
            error.add_note(words)
        if error is None and self._failure is not None:
            raise self._failure

    def _wait_for(self, done: Callable[[], bool]) -> None:
        self._changed.wait_for(lambda: self._closing or done(), self._wait)
        if done():
            return
        self._request = None
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        if self._closing:
            raise DriverError(f"the stepper of {self._periods.robot} has ended; valid: a new one")
        if self._periods.moment is not None:
            self._periods.moment.perceived()
        raise DriverError(f"the loop of {self._periods.robot} has not answered for {self._wait:.1f} s")

    def _work(self) -> None:
        control = self._periods.control
        try:
            with interruptions() as interruption, frozen_garbage(), attentive(), control:
                self._begun = True
                for moment in control.periods():
                    with self._changed:
                        self._periods.note(moment)
                        request, self._request = self._request, None
                        self._changed.notify_all()
                    sent = self._periods.act(moment, None if request is None else request.orders)
                    interruption.raise_it()
                    if request is not None:
                        with self._changed:
                            request.sent = sent
                            self._changed.notify_all()
                    if self._closing or not threading.main_thread().is_alive():
                        break
                if self._cause is not None:
                    control.stop(f"{type(self._cause).__name__}: {self._cause}", self._cause)
        except BaseException as error:
            self._failure = error
            _log.error(
                "the stepper of %s has ended: %s: %s", self._periods.robot, type(error).__name__, error
            )
        finally:
            with self._changed:
                self._closing = True
                self._changed.notify_all()


_opened = 0
"""Number of open steppers that rely on `_leave`."""


def _leave(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _exit_when_terminated() -> bool:
    """Makes SIGTERM an exception in the main thread, so that a `with` block brings the robot to rest. False
    in other threads, and if the program has a handler of its own."""
    global _opened
    if threading.current_thread() is not threading.main_thread():
        return False
    if signal.getsignal(signal.SIGTERM) not in (signal.SIG_DFL, _leave):
        return False
    signal.signal(signal.SIGTERM, _leave)
    _opened += 1
    return True


def _die_when_terminated() -> None:
    """The contrary, after the last stepper. Only the main thread can set a handler, so that a stepper which
    another thread closes leaves it."""
    global _opened
    _opened -= 1
    here = threading.current_thread() is threading.main_thread()
    if here and not _opened and signal.getsignal(signal.SIGTERM) is _leave:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
