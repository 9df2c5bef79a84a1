"""`run`: a capability on a robot, in one thread.

When the run ends, also after an error, the robot is first brought to rest. After that, `run` raises the error
of the capability, of an observer or of a thread.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import TypeVar

from tci.body.generic_body import BodySettings, GenericBody
from tci.capabilities.capability import Capability, lacks
from tci.capabilities.orders import begin_of, step_of
from tci.capabilities.wrapper import unwrapped
from tci.drivers.driver import Driver
from tci.errors import CommandError
from tci.messages import Order, Reading
from tci.reasons import Reason
from tci.runtime.arguments import as_capability, as_driver, check_duration
from tci.runtime.control import Control
from tci.runtime.habits import Habits
from tci.runtime.loop_report import LoopReport
from tci.runtime.moment import Tick as Tick
from tci.runtime.result import Account, RunResult
from tci.runtime.watchdogs import Watchdog, frozen_garbage, interruptions, usual_watchdogs

Memory = TypeVar("Memory")


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

    What the robot lacks for the capability (`Capability.needs`) is logged at the start, and in the result.

    Before the robot moves, raises TciError for an invalid duration or argument, CommandError if the gate
    refuses the capability's first commands, and DriverError if another process commands the robot. After the
    robot has come to rest, raises CommandError if a step of the capability did not return commands and
    memory. At this time, `run` also raises errors of the driver, of the capability, of an observer or of a
    thread.
    """
    check_duration(duration)
    driver, capability = as_driver(driver), as_capability(capability)
    body = GenericBody(driver.robot, settings or BodySettings())
    report, name = report or LoopReport(), type(unwrapped(capability)).__name__
    account = Account(driver, tuple(f"{name}: {words}" for words in lacks(capability, driver.robot)))
    memory, begun, habits = capability.init(body), False, Habits(capability, driver.period)
    needed = {patch.name for need in capability.needs for patch in need.skin_of(driver.robot)}
    watchdogs: tuple[Watchdog, ...] = usual_watchdogs(driver, needed)
    if guard is not None:
        watchdogs = (lambda moment: guard(), *watchdogs)
    control = Control(
        driver, body, who=f"the run of {name}", watchdogs=watchdogs, sensed=sensed, see=observe,
        report=report, write=write,
    )  # fmt: skip
    with interruptions() as interruption, frozen_garbage(), control:
        try:
            for moment in control.periods(duration=duration):
                orders: tuple[Order, ...] = ()
                opening = False
                seen = moment.perception
                if seen is not None:
                    if not begun:
                        orders = begin_of(capability, seen, body)
                        opening = bool(orders)
                    if not opening:
                        before = perf_counter()
                        orders, memory = step_of(capability, memory, seen, body)
                        habits.add(perf_counter() - before)
                    if fault := capability.fault(seen, body):
                        driver.gate.stop(fault)
                    begun = True
                sent = control.act(orders)
                account.add(seen, moment.reading.joints.position, sent, opening=opening)
                if opening and write and sent.refusals:
                    raise CommandError(f"{name} can't begin: {'; '.join(map(str, sent.refusals))}")
                interruption.raise_it()
                if until is not None and until(memory):
                    break
            control.finish()
            interruption.raise_it()
            report.ended = "done"
            return account.result(memory, report, habits.advice())
        except BaseException as error:
            interruption.rests = True
            where = f" in thread {interruption.thread}" if error is interruption.failure else ""
            kind = "Ctrl-C" if isinstance(error, KeyboardInterrupt) else type(error).__name__
            report.ended = f"{kind}{where}: {error}".removesuffix(": ")
            control.stop(report.ended, error)
            raise
