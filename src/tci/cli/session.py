"""Runs a capability with a recording, injected faults and a log of events. The command `tci run` uses this
module."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import Any

from tci.body.generic_body import GenericBody
from tci.body.touchable import touchable
from tci.capabilities.capability import Capability, lacks
from tci.capabilities.fields import default_fields
from tci.capabilities.finger_reflex.capability import FingerReflex
from tci.capabilities.wrapper import CapabilityWrapper
from tci.cli.run_log import Event, RunLog
from tci.drivers.combined_server import JOIN
from tci.drivers.driver import Driver
from tci.drivers.replay import ReplayDriver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.lab.faults.injectors import INJECTORS, THREAD
from tci.messages.frames import Array
from tci.reasons import OTHERS, Code, Reason, ReasonCounter
from tci.recording.recorder import Recorder
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.runtime.result import RunResult
from tci.simulation.poke_first import poke_first
from tci.skin.skin import Skin

REHEARSAL = 1.5
"""Shortest duration [s] of a run with an injected fault. Assumed: one poke and the robot's response need less
time."""
FLICKER = 0.4
"""Noise [counts] of the simulated skin in a run with injected faults. Assumed: values are rounded to whole
counts, so with this noise most values stay constant, and some change by one count."""
POKE_DELAY = 0.3
"""The simulated finger touches the robot this time [s] after the start of the run. Until the touch, the robot
is at rest.
"""


def _unarmed() -> Reason:
    """Returns the reason to hold a robot whose driver is not armed."""
    return Reason(Code.NOT_ARMED, "the connection is read-only: nothing is sent; --arm lets the robot move")


class Session:
    """One run of a capability on an open driver. The method `run` executes the run. The other members report
    the result of the run.
    """

    def __init__(
        self,
        driver: Driver,
        capability: Capability[Any],
        *,
        faults: Sequence[FaultPlan] = (),
        flicker: float = 0.0,
        recorder: Recorder | None = None,
        listen: Callable[[Event], None] = lambda event: None,
        observe: Callable[[Tick], None] = lambda tick: None,
    ) -> None:
        """Prepares a run.

        Args:
            driver: Open driver of the robot.
            capability: Capability to run.
            faults: Faults to inject.
            flicker: Noise [counts] of the skin while faults are injected.
            recorder: Open recorder for the data of each period.
            listen: Function that the session calls immediately with each event.
            observe: Function that the session calls with each tick.
        """
        self.source = driver
        """The driver of the robot, without injected faults."""
        self.driver = FaultInjector(driver, faults, flicker=flicker) if faults else driver
        """The driver that the capability uses. This is `source`, or a driver that injects faults into
        `source`.
        """
        self.recorder = recorder
        self.report = LoopReport()
        self.log = RunLog(self.driver, listen)
        self.result: RunResult[Any] | None = None
        """Result of the run. The value is None if the run ended with an error."""
        self.error: BaseException | None = None
        """Exception that ended the run: an error of the capability, or the exception that a signal raised.
        The value is None if no exception ended the run."""
        self.memory: Any = None
        """The capability's memory after the latest period, also if the run was interrupted."""
        self._capability, self._observe = capability, observe

    @property
    def failed(self) -> bool:
        """True if the gate stopped the robot, if an error ended the run, or if the gate refused every command
        to an armed robot."""
        return self.log.worst is GateState.STOP or (self.driver.armed and not self.result)

    def run(self, duration: float | None = None) -> None:
        """Runs the capability for `duration` [s], or until the user interrupts the run. If a signal or an
        error ends the run, stores the exception in `error` and does not raise the exception. Raises only
        errors that occur before the run starts.
        """
        notes, clock, log = ReasonCounter(), self.driver.clock, self.log

        world = self.driver.world if isinstance(self.driver, SimulatedDriver) else None

        def see(tick: Tick) -> None:
            if self.recorder is not None:
                touching = {} if world is None else world.touching()
                self.recorder.tick(
                    tick.now,
                    tick.reading,
                    tick.commands,
                    tick.sent if self.driver.armed else None,
                    tick.perception,
                    touching,
                )
            log.see(tick)
            self._observe(tick)

        def take_notes(memory: Any) -> bool:
            self.memory = memory
            for note in self._capability.notes(memory):
                if notes.add(Reason.of(note), clock.now()):
                    log.write(clock.now(), "NOTE", note)
            return False

        with _quiet_threads() if self.driver is not self.source else contextlib.nullcontext():
            try:
                self.result = run(
                    self.driver, self._capability, duration=duration, observe=see, until=take_notes,
                    report=self.report, write=self.driver.armed,
                    guard=None if self.driver.armed else _unarmed,
                )  # fmt: skip
            except (Exception, KeyboardInterrupt, SystemExit) as error:
                if not self.report.ended:  # the run has not started
                    raise
                self.error = error
                log.tell_faults(clock.now())
                rest = "; the robot was brought to rest" if self.driver.armed else ""
                log.worst = GateState.STOP
                log.write(clock.now(), "STOP", f"{self.report.ended}{self._place(error)}{rest}")
        if self.driver.armed and self.result is not None and self.result.refused_all:
            log.write(clock.now(), "refused", "every command was refused, so the capability moved nothing")
        if self.report.cut_short:
            log.write(clock.now(), "at rest", "the run ended during a motion; a hold stopped it")
        if notes.counts[OTHERS]:
            log.write(clock.now(), "NOTE", "further notes are not shown")

    def to_json(self) -> dict[str, Any]:
        """Returns all results of the run as JSON values."""
        counts = self.driver.gate.counts
        fields: dict[str, Any] = {
            "state": self.driver.gate.state.value,
            "worst": self.log.worst.value,
            "events": [event.to_json() for event in self.log.events],
            "refusals": [notice.to_json() for notice in self.log.refused.notices()],
            "clamps": [notice.to_json() for notice in self.log.clamped.notices()],
            "went_back": [notice.to_json() for notice in self.log.went_back.notices()],
            "faults": self.log.outcome(),
            "gate": {"holds": counts.holds, "stops": counts.stops, "refusals": counts.refusals,
                     "clamps": dict(counts.clamps), "near_misses": counts.near_misses},
            "loop": self.report.to_json(),
        }  # fmt: skip
        if self.result is not None:
            fields |= {
                "touched_N": dict(self.result.touched),
                "switches": [*self.result.switches],
                "moved_rad": dict(self.result.moved),
                "lacks": [*self.result.lacks],
                "by_torques": self.result.by_torques,
                "advice": [*self.result.advice],
            }
        if self.recorder is not None:
            fields["recording"] = self.recorder.to_json()
        if isinstance(self.source, ReplayDriver):
            fields["replay"] = {"compared": self.source.compared, "different": len(self.source.different),
                              "other_versions": self.source.changed}  # fmt: skip
        return fields

    def _place(self, error: BaseException) -> str:
        """Returns the place of an error as text for a message: the file and the line, if the error passed
        through the file of the capability's class; otherwise an empty text.
        """
        file = sys.modules[type(self._capability).__module__].__file__
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == file]
        return f" ({Path(str(file)).name}, line {lines[-1]})" if lines else ""


def rehearsal_length(faults: Sequence[FaultPlan]) -> float:
    """Returns the shortest duration [s] of a run that contains the responses to one poke and to each
    fault."""
    return max(REHEARSAL, *(plan.at + INJECTORS[plan.name].shows_after + 1.0 for plan in faults))


def recorder_for(
    path: Path, driver: Driver, via: str, about: Mapping[str, str], *, task: str | None = None
) -> Recorder:
    """Opens a recorder for the readings of a driver. Raises the errors of `Recorder`.

    Args:
        path: File to write.
        driver: Driver whose robot, period and facts the recorder writes into the file.
        via: NAME or NAME:ADDRESS that was used to open the driver.
        about: Further facts about the recording, by key.
        task: What it shows, for data sets; None says nothing.
    """
    return Recorder(
        path,
        driver.robot,
        middleware=via.split(JOIN)[0].partition(":")[0],
        period=driver.period,
        keep_alive=driver.info.keep_alive,
        about={**driver.info.about, **about, **({"task": task} if task else {})},
    )


def about_capability(name: str, capability: Capability[object]) -> dict[str, str]:
    """Returns metadata for a recording: the name and the settings of the capability that ran."""
    return {"capability": name, "settings": repr(capability)}


def hanging(capability: Capability[Any], robot: Robot) -> dict[str, Array]:
    """The angles [rad] in which a simulated robot's hands hang before it is touched, by part: half bent for
    `FingerReflex`, which else bends them first, away from the finger that comes."""
    while isinstance(capability, CapabilityWrapper):
        capability = capability.inner
    if not isinstance(capability, FingerReflex) or lacks(capability, robot):
        return {}
    body = GenericBody(robot)
    return {hand: capability.relaxed(hand, body) for hand in body.parts("fingers")}


def poke_skin(driver: Driver, capability: Capability[Any] | None = None) -> str:
    """Pokes the skin that is there with the simulated finger: what `capability` needs, else the left forearm,
    else the next place that the finger reaches.

    Returns the name of the poked patch, empty if the robot has no skin. Raises CommandError for a real robot.
    """
    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--poke needs a simulated robot; valid: --via sim")
    robot, world = driver.robot, driver.world
    wanted = set() if capability is None else skin_needed(capability, robot)
    places = touchable(Skin(robot), driver.read().joints, [field.place for field in default_fields()])
    for one in sorted(places, key=lambda one: one.place.patch not in wanted):
        poked = poke_first(world, [one], speed=0.25, depth=0.01, gap=0.25 * POKE_DELAY)  # about 8 N
        if poked and not world.finger.covered(one.place.patch):
            return one.place.patch
    world.finger.retire()
    return ""


def skin_needed(capability: Capability[Any], robot: Robot) -> set[str]:
    """The patches of a robot that count as the skin that a capability needs."""
    return {patch.name for need in capability.needs for patch in need.skin_of(robot)}


def not_poked(driver: Driver, patch: str) -> list[str]:
    """Why the simulated finger, after a run that began with `poke_skin`, has not touched `patch`; empty if it
    has."""
    assert isinstance(driver, SimulatedDriver)  # `poke_skin` refuses others
    if not patch:
        return [f"the simulated finger found no skin on {driver.robot.name} to poke; robots: tci robots"]
    if driver.world.finger.first_contact is not None:
        return []
    ended = f"the simulated finger did not touch {patch}"
    enough = ceil(2.0 * POKE_DELAY)
    if driver.world.time >= enough:
        return [f"{ended}: the robot moved away before"]
    return [f"{ended}: the run ended before; valid: --duration {enough} or more, or none"]


@contextlib.contextmanager
def _quiet_threads() -> Iterator[None]:
    """Suppresses, inside the `with` block, the traceback of a thread that was ended by an injected fault."""
    usual = threading.excepthook

    def hook(failed: threading.ExceptHookArgs) -> None:
        if failed.thread is None or failed.thread.name != THREAD:
            usual(failed)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = usual
