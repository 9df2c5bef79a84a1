"""Prints the events of a run: state changes, reasons for holds, the outcome of each injected fault."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tci.cli.console import console
from tci.drivers.driver import Driver
from tci.drivers.faults.fault_injector import FaultInjector, FaultPlan
from tci.drivers.faults.fault_list import FAULTS
from tci.drivers.faults.injectors import INJECTORS
from tci.gate.gate import GateState
from tci.messages import GenericCommand, Mode
from tci.reasons import Reason, ReasonCounter
from tci.runtime.loop import Tick
from tci.runtime.loop_report import LoopReport

COLOURS = {GateState.RUN: "green", GateState.HOLD: "yellow", GateState.STOP: "bold red"}
MEANING = {
    GateState.RUN: "commands pass, within limits; motions from before are not resumed",
    GateState.HOLD: "the robot stops and keeps its position until the cause is gone",
    GateState.STOP: "the robot stops and stays stopped until an operator resets it",
}
LULL = 0.5
"""Time [s] that a place must be free of contact before its next touch is printed. Assumed: a hand that
slides makes and breaks contact faster."""
STILL = 1e-6
"""Commanded speed [rad/s] below which a joint counts as at rest: rounding only."""


class RunLog:
    """Prints each change as one line, and below them a line with the current state."""

    def __init__(self, driver: Driver, report: LoopReport, live: Live | None) -> None:
        self.events: list[dict[str, Any]] = []
        """All events that were printed: time [s], kind and text."""
        self.worst = GateState.RUN
        """Worst state so far: STOP before HOLD before RUN."""
        self.refused, self.clamped = ReasonCounter(), ReasonCounter()
        self._driver, self._report, self._live = driver, report, live
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
        """Prints the changes of one tick of the loop."""
        self.tell_faults(tick.now)
        self._touches(tick)
        self._skin(tick)
        state = tick.sent.state
        now_state = (state, tick.sent.reason if state is GateState.STOP else None)
        if now_state != self._state:
            self._state = now_state
            reason = tick.sent.reason or "no fault any more"
            self.tell(tick.now, state.name, f"{reason} ({MEANING[state]})", COLOURS[state])
            self._ended = None if state is GateState.RUN else self._ended or tick.now
        if state is GateState.STOP or self.worst is GateState.RUN:
            self.worst = state
        if self._ended is not None and not (np.abs(tick.sent.velocity) > STILL).any():
            late = (tick.now - self._ended) * 1e3
            self.tell(tick.now, "at rest", f"all servos are commanded to rest after {late:.0f} ms", "dim")
            self._ended = None
        self._judged(tick)
        for command in tick.commands:
            if isinstance(command, GenericCommand) and not tick.sent.refusals:
                self._command(tick.now, command)
        if self._live is not None:
            self._live.update(self._line(tick))

    def tell_faults(self, now: float) -> None:
        """Prints the faults that began or ended since the last call."""
        if not isinstance(self._driver, FaultInjector):
            return
        for plan in self._driver.begun[len(self._begun) :]:
            self._begun.append((now, plan))
            expected = FAULTS[INJECTORS[plan.name].number].expected
            self.tell(
                now, "FAULT", f"{plan}: {INJECTORS[plan.name].description}; expected: {expected}", "magenta"
            )
        for begin, plan in self._begun:
            if plan not in self._over and now - begin >= plan.lasts:
                self._over.add(plan)
                self.tell(now, "over", f"{plan.name} has ended", "magenta")

    def tell(self, now: float, kind: str, words: str, colour: str) -> None:
        """Prints one event as a line, and stores it."""
        self.events.append({"time_s": round(now, 4), "kind": kind, "words": words})
        if self._live is not None:
            console.print(_row(f"{now:8.3f} s", kind, words, colour))

    def outcome(self) -> list[dict[str, Any]]:
        """Returns for each fault its begin [s], the expected reaction, and the first reaction of the gate."""
        told = []
        for begin, plan in self._begun:
            after = [event for event in self.events if event["time_s"] >= round(begin, 4)]
            kinds = (("HOLD", "STOP"), ("MASK",))
            answers = [event for among in kinds for event in after if event["kind"] in among]
            first = answers[0] if answers else None
            told.append(
                {
                    "fault": plan.name,
                    "began_s": round(begin, 4),
                    "expected": FAULTS[INJECTORS[plan.name].number].expected,
                    "answer": first and first["kind"],
                    "after_s": first and max(0.0, round(first["time_s"] - begin, 4)),
                    "why": first and first["words"].partition(" (")[0],
                }
            )
        return told

    def conclude(self) -> None:
        """Prints one line for each repeated refusal or clamp, and for each fault with its outcome."""
        for kind, reasons in (("refused", self.refused), ("clamped", self.clamped)):
            for notice in reasons.notices():
                if notice.count > 1:
                    console.print(_row("", kind, str(notice), "yellow"))
        for one in self.outcome():
            shows = INJECTORS[one["fault"]].shows_after
            if one["answer"]:
                after = one["after_s"]
                late = f"{after * 1e3:.0f} ms" if after < 1.0 else f"{after:.1f} s"
                words = f"{one['answer']} {late} after {one['fault']}: {one['why']}"
            elif shows:
                words = (
                    f"{one['fault']}: the gate did not react. It detects this fault {shows:g} s after its "
                    f"begin, on skin that it has read for some seconds; try {one['fault']}@5"
                )
            else:
                words = f"{one['fault']}: the gate had no reason to hold"
            console.print(_row("", "outcome", f"{words}; expected: {one['expected']}", "bold"))

    def _touches(self, tick: Tick) -> None:
        contacts = {contact.identity: contact for contact in tick.perception.contacts}
        for contact in (contacts[identity] for identity in contacts.keys() - self._contacts):
            where = f"{contact.segment} of {contact.part}" if contact.segment else contact.part
            if tick.now - self._touched.get(where, -np.inf) > LULL:
                self.tell(tick.now, "touch", where, "blue")
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
                self.tell(tick.now, "MASK", words, "yellow")

    def _judged(self, tick: Tick) -> None:
        for reason in tick.sent.refusals:
            if self.refused.add(reason, tick.now):
                self.tell(tick.now, "refused", reason.text, "yellow")
        for words in tick.sent.clamped:
            if self.clamped.add(Reason.of(words), tick.now):
                self.tell(tick.now, "clamped", words, "yellow")

    def _command(self, now: float, command: GenericCommand) -> None:
        if self._modes.get(command.part) is not command.mode:
            self._modes[command.part] = command.mode
            self.tell(now, "command", f"{command.part} in {command.mode.value} mode", "cyan")

    def _line(self, tick: Tick) -> Text:
        state = tick.sent.state
        line = Text(f"{tick.now:8.3f} s  ")
        line.append(f" {state.name} ", style=f"reverse {COLOURS[state]}")
        counts = self._driver.gate.counts
        line.append(
            f"  contacts {len(tick.perception.contacts)}  clamps {sum(counts.clamps.values())}  "
            f"refusals {counts.refusals}  overruns {self._report.overruns}"
        )
        return line


def _row(time: str, kind: str, words: str, colour: str) -> RenderableType:
    """Lays out an event in three columns. Text that needs more than one line stays in its column."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(width=10, justify="right", no_wrap=True)
    table.add_column(width=7, no_wrap=True)
    table.add_column()
    table.add_row(time, Text(kind, style=colour), Text(words))
    return table
