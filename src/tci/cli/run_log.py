"""Events of a run: touches, state changes, reasons for holds, and the outcome of each injected fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tci.drivers.driver import Driver
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.lab.faults.fault_list import FAULTS
from tci.lab.faults.injectors import INJECTORS
from tci.messages import GenericCommand, Mode
from tci.reasons import Code, Reason, ReasonCounter
from tci.runtime.loop import Tick

MEANING = {
    GateState.RUN: "commands pass, within limits; motions from before are not resumed",
    GateState.HOLD: "the robot stops and keeps its position until the cause is gone",
    GateState.STOP: "the robot stops and stays stopped until an operator types reset, and Enter",
}
LULL = 0.5
"""Time [s] without contact after which a new contact on a patch is a new event. Assumed: when a hand slides
over a patch, the contact is lost for shorter times."""
STILL = 1e-6
"""A joint counts as at rest if its commanded speed [rad/s] is below this value. Assumed: larger than rounding
errors."""


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a run."""

    now: float
    """Time [s] on the driver's clock."""
    kind: str
    """Kind of the event. Events of the skin are touch, and MASK for masked taxels. Events of commands are
    command, refused and clamped. Events of the gate are HOLD, STOP, RUN, CONTACT and at rest. Events of
    injected faults are FAULT and over. Events of the capability are NOTE, of whoever types at the terminal
    OPERATOR."""
    words: str

    def to_json(self) -> dict[str, Any]:
        """Returns the event as JSON values."""
        return {"time_s": round(self.now, 4), "kind": self.kind, "words": self.words}


class RunLog:
    """Finds the events of a run in the data of each tick. Passes each event to the function `listen`
    immediately."""

    def __init__(self, driver: Driver, listen: Callable[[Event], None]) -> None:
        self.events: list[Event] = []
        """All events since the start of the run, the earliest first."""
        self.worst = GateState.RUN
        """Worst state of the gate since the start of the run. STOP is worse than HOLD, and HOLD is worse than
        RUN."""
        self.refused, self.clamped, self.went_back = ReasonCounter(), ReasonCounter(), ReasonCounter()
        self._driver, self._listen = driver, listen
        self._state: tuple[GateState, Reason | None] = (GateState.RUN, None)
        self._begun: list[tuple[float, FaultPlan]] = []
        self._over: set[FaultPlan] = set()
        self._modes: dict[str, Mode] = {}
        self._contacts: set[int] = set()
        self._touched: dict[str, float] = {}
        self._masked: dict[str, int] = {}
        self._patches = [patch.name for patch in driver.robot.patches]
        self._ended: float | None = None

    def see(self, tick: Tick) -> None:
        """Finds and stores the events of one tick of the loop."""
        self.tell_faults(tick.now)
        self._touches(tick)
        self._skin(tick)
        state = tick.sent.state
        now_state = (state, tick.sent.reason if state is GateState.STOP else None)
        if now_state != self._state:
            self._state = now_state
            reason = tick.sent.reason or "no fault any more"
            armed = self._driver.armed
            self.write(tick.now, state.name, f"{reason} ({MEANING[state]})" if armed else str(reason))
            self._ended = None if state is GateState.RUN or not armed else self._ended or tick.now
        if state is GateState.STOP or self.worst is GateState.RUN:
            self.worst = state
        if self._ended is not None and not (np.abs(tick.sent.velocity) > STILL).any():
            late = (tick.now - self._ended) * 1e3
            self.write(tick.now, "at rest", f"all servos are commanded to rest after {late:.0f} ms")
            self._ended = None
        self._judged(tick)
        for command in tick.commands:
            if isinstance(command, GenericCommand) and not tick.sent.refusals:
                self._command(tick.now, command)

    def tell_faults(self, now: float) -> None:
        """Stores an event for each fault that began or ended since the last call."""
        if not isinstance(self._driver, FaultInjector):
            return
        for plan in self._driver.begun[len(self._begun) :]:
            self._begun.append((now, plan))
            expected = FAULTS[INJECTORS[plan.name].number].expected
            words = f"{plan}: {INJECTORS[plan.name].description}; expected: {expected}"
            self.write(now, "FAULT", words)
        for begin, plan in self._begun:
            if plan not in self._over and now - begin >= plan.lasts:
                self._over.add(plan)
                self.write(now, "over", f"{plan.name} has ended")

    def write(self, now: float, kind: str, words: str) -> None:
        """Stores one event and passes it to `listen`."""
        event = Event(now, kind, words)
        self.events.append(event)
        self._listen(event)

    def outcome(self) -> list[dict[str, Any]]:
        """Returns the outcome of each injected fault.

        Each outcome contains the start time [s] of the fault, the expected reaction, and the first reaction
        of the gate or of the skin conditioning.
        """
        lines = []
        for begin, plan in self._begun:
            after = [event for event in self.events if round(event.now, 4) >= round(begin, 4)]
            kinds = (("HOLD", "STOP", "CONTACT"), ("MASK",))
            answers = [event for among in kinds for event in after if event.kind in among]
            first = answers[0] if answers else None
            lines.append(
                {
                    "fault": plan.name,
                    "began_s": round(begin, 4),
                    "expected": FAULTS[INJECTORS[plan.name].number].expected,
                    "answer": first and first.kind,
                    "after_s": first and max(0.0, round(first.now - begin, 4)),
                    "why": first and first.words.partition(" (")[0],
                }
            )
        return lines

    def _touches(self, tick: Tick) -> None:
        contacts = {contact.identity: contact for contact in tick.perception.contacts}
        for contact in (contacts[identity] for identity in contacts.keys() - self._contacts):
            where = f"{contact.segment} of {contact.part}" if contact.segment else contact.part
            if tick.now - self._touched.get(where, -np.inf) > LULL:
                self.write(tick.now, "touch", where)
            self._touched[where] = tick.now
        self._contacts = {*contacts}

    def _skin(self, tick: Tick) -> None:
        skin = tick.skin
        for p, name in enumerate(self._patches):
            own = slice(*skin.taxels[p : p + 2].tolist())
            masked = 0 if skin.masked is None else int(np.count_nonzero(skin.masked[own]))
            if masked != self._masked.get(name, 0):
                self._masked[name] = masked
                count = own.stop - own.start
                others = "none is left" if masked == count else "the others are used"
                words = f"{name}: {masked} of {count} taxels are masked as faulty; {others}"
                self.write(tick.now, "MASK", words)

    def _judged(self, tick: Tick) -> None:
        for reason in tick.sent.refusals:
            if self.refused.add(reason, tick.now):
                self.write(tick.now, "refused", reason.text)
        for clamp in tick.sent.clamped:
            if clamp.code is Code.CONTACT:
                if self.went_back.add(clamp, tick.now):
                    self.write(tick.now, "CONTACT", str(clamp))
            elif self.clamped.add(clamp, tick.now):
                self.write(tick.now, "clamped", str(clamp))

    def _command(self, now: float, command: GenericCommand) -> None:
        if self._modes.get(command.part) is not command.mode:
            self._modes[command.part] = command.mode
            self.write(now, "command", f"{command.part} in {command.mode.value} mode")
