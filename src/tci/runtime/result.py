"""The result of a run: the capability's memory, and a summary of touches, motions and refusals."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from tci.drivers.driver import Driver
from tci.gate.gate import GateState, SafeCommand
from tci.messages import Perception
from tci.messages.frames import Array
from tci.reasons import Code, Notice, Reason, ReasonCounter, text_of
from tci.runtime.loop_report import LoopReport

MOVED = float(np.deg2rad(1.0))
"""A servo counts as moved if its angle changed by at least this value [rad] during the run. Assumed: gravity
turns a servo at rest by a smaller angle."""
SHOWN = 6
"""Largest number of entries in each list (moved servos, refusals, clamps, holds) of the summary of a run.
Assumed: users do not read longer lists."""
MOSTLY = 0.95
"""Share of a run from which on nothing is said of torques."""
ELSE = "else only skin did, and joints that stayed behind; why: tci doctor"
AGAIN = "see what is in its way, then order the motion again"
MET = f"a part met something; {AGAIN}"
"""Last words of a run in which a part answered contact. The robot did what it should: no failure."""

Memory = TypeVar("Memory")
_log = logging.getLogger("tci.run")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RunResult(Generic[Memory]):
    """Result of a run that has ended. `print` shows the result in a few lines.

    `bool(result)` is False if the gate stopped the robot or refused every command. Clamped commands do not
    make the result False, since the robot executed these commands within the limits; `clamps` lists these
    commands. A stop raises no exception, because after an exception the caller would not get the memory and
    the reasons.
    """

    memory: Memory
    """Memory of the capability after the last step."""
    report: LoopReport
    """Timing statistics of the loop."""
    robot: str
    """Name of the robot."""
    state: GateState
    """State of the gate at the end of the run."""
    reason: Reason | None
    """Reason for the gate's state HOLD or STOP at the end of the run. The value is None if the gate is in the
    state RUN."""
    touched: Mapping[str, float]
    """Largest force [N] of a contact on each patch that was touched. The keys are the names of the patches,
    beginning with the patch that was touched first."""
    moved: Mapping[str, float]
    """Difference [rad] between the largest and the smallest angle of each servo that moved. The keys are the
    names of the servos, beginning with the servo with the largest difference."""
    accepted: int
    """Number of commands that the gate accepted. The first orders of the capability (`begin`) do not
    count."""
    refusals: tuple[Notice, ...]
    """Reasons for which the gate refused commands, one notice per kind of reason."""
    clamps: tuple[Notice, ...]
    """Reasons for which the gate clamped commands or ended their motions early, one notice per kind of
    reason."""
    holds: tuple[Notice, ...]
    """Reasons for which the gate held the robot, one notice per kind of reason. The `count` of a notice is
    the number of periods in which the gate held the robot for this reason."""
    went_back: tuple[Notice, ...] = ()
    """Parts that met something (code CONTACT), and whether each went back, gave way or stopped; one notice
    per kind of reason."""
    lacks: tuple[str, ...] = ()
    """What the robot lacks for the capability: `WithdrawalReflex: no skin on an arm of this robot`."""
    switches: tuple[str, ...] = ()
    """Patches in `touched` that only tell pressed or not. Their force there is the one that closes the
    switch; with what force they were pressed nobody knows."""

    by_torques: float | None = None
    """Share of the run, 0 to 1, in which measured joint torques told whether a part met something. In the
    rest only skin did, and joints that stayed behind. None in simulation, if nothing was ordered or moved,
    and if another process watches."""
    advice: tuple[str, ...] = ()
    """Habits of the capability that nobody notices in simulation, with what to do."""

    @property
    def ended(self) -> str:
        """Reason for which the run ended."""
        return self.report.ended

    @property
    def refused_all(self) -> bool:
        """True if the gate refused at least one command and accepted no command."""
        return bool(self.refusals) and not self.accepted

    def __bool__(self) -> bool:
        return self.state is not GateState.STOP and not self.refused_all

    @property
    def unfelt(self) -> tuple[str, ...]:
        """A line about a run in which joint torques told of nobody for a while."""
        if self.by_torques is None or self.by_torques >= MOSTLY:
            return ()
        return (f"joint torques told who was met for {self.by_torques:.0%} of the run; {ELSE}",)

    @property
    def summary(self) -> str:
        """One line of text with the touched patches and the joints that moved."""
        touched = ", ".join(
            f"{patch} ({'pressed' if patch in self.switches else f'{force:.1f} N'})"
            for patch, force in self.touched.items()
        )
        moved = ", ".join(f"{name} {np.rad2deg(way):.0f}" for name, way in [*self.moved.items()][:SHOWN])
        more = f" and {len(self.moved) - SHOWN} more" if len(self.moved) > SHOWN else ""
        moves = f"moved {moved} degrees{more}" if moved else "; ".join(self.lacks) or "nothing moved"
        return f"{self.robot}: touched {touched or 'nowhere'}; {moves}"

    def __repr__(self) -> str:
        lines = [self.summary]
        kinds = {
            "refused": self.refusals, "clamped": self.clamps, "held": self.holds, "met": self.went_back
        }  # fmt: skip
        for kind, notices in kinds.items():
            lines += [f"{kind} {notice}" for notice in notices[:SHOWN]]
            if others := notices[SHOWN:]:
                count = sum(notice.count for notice in others)
                lines.append(f"{kind} {count} x for {len(others)} further reasons")
        if self.state is not GateState.RUN:
            lines.append(f"{self.state.name} at the end: {self.reason}")
        if self.went_back:
            lines.append(MET)
        lines += self.unfelt
        lines += self.advice
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Returns all fields except the memory as JSON values. Times are in [s], except in the loop's timing
        statistics, which are in [ms].
        """
        return {
            "robot": self.robot,
            "ok": bool(self),
            "state": self.state.value,
            "reason": text_of(self.reason),
            "code": None if self.reason is None else self.reason.code.name,
            "touched_N": dict(self.touched),
            "switches": [*self.switches],
            "moved_rad": dict(self.moved),
            "lacks": [*self.lacks],
            "by_torques": self.by_torques,
            "advice": [*self.advice],
            "accepted": self.accepted,
            "refusals": [notice.to_json() for notice in self.refusals],
            "clamps": [notice.to_json() for notice in self.clamps],
            "holds": [notice.to_json() for notice in self.holds],
            "went_back": [notice.to_json() for notice in self.went_back],
            "loop": self.report.to_json(),
        }


class Account:
    """Collects the data for the result of a run in each period. Logs the first refusal, the first clamp and
    the first hold of each kind."""

    def __init__(self, driver: Driver, lacks: tuple[str, ...] = ()) -> None:
        """`lacks` is what the robot lacks for the capability that runs."""
        self._driver, self._lacks = driver, lacks
        for words in lacks:
            _log.warning("%s: %s", driver.robot.name, words)
        self._touched: dict[str, float] = {}
        self._low: Array | None = None
        self._high = np.zeros(0)
        self._accepted = 0
        self._refusals, self._clamps, self._holds = ReasonCounter(), ReasonCounter(), ReasonCounter()
        self._went_back = ReasonCounter()
        self._stopped: Reason | None = None
        gate = driver.gate
        watches = gate.settings.contact is not None and not driver.info.harmless
        self._begun = gate.counts if watches else None

    def add(self, seen: Perception | None, position: Array, sent: SafeCommand, *, opening: bool) -> None:
        """Adds the data of one period. `seen` is the perception, or None if the reading did not fit the
        robot's description. `position` (n_servos,) [rad] are the servos' angles. `opening` is True if the
        orders in `sent` are the capability's first orders (`begin`).
        """
        if seen is not None:
            self._touch(seen)
            if self._low is None:
                self._low, self._high = position.copy(), position.copy()
            np.fmin(self._low, position, out=self._low)
            np.fmax(self._high, position, out=self._high)
        if sent.orders and not opening:
            self._accepted += len(sent.orders)
        for refusal in sent.refusals:
            self._note(self._refusals, "refused", refusal, sent.stamp)
        for clamp in sent.clamped:
            if clamp.code is Code.CONTACT:
                self._note(self._went_back, "met", clamp, sent.stamp)
            else:
                self._note(self._clamps, "clamped", clamp, sent.stamp)
        if sent.state is GateState.HOLD and sent.reason is not None:
            self._note(self._holds, "held", sent.reason, sent.stamp)
        elif sent.state is GateState.STOP:
            self._stop(sent.reason, sent.stamp)

    def result(self, memory: Memory, report: LoopReport, advice: tuple[str, ...] = ()) -> RunResult[Memory]:
        """Returns the result of the finished run, in which the capability had the habits `advice`."""
        gate = self._driver.gate
        if gate.state is GateState.STOP:
            self._stop(gate.reason, self._driver.clock.now())
        return RunResult(
            memory=memory,
            report=report,
            robot=self._driver.robot.name,
            state=gate.state,
            reason=gate.reason,
            touched=dict(self._touched),
            moved=self._moved(),
            accepted=self._accepted,
            refusals=self._refusals.notices(),
            clamps=self._clamps.notices(),
            holds=self._holds.notices(),
            went_back=self._went_back.notices(),
            lacks=self._lacks,
            advice=advice,
            by_torques=self._by_torques(),
            switches=tuple(name for name in self._touched if name in self._driver.robot.switches),
        )

    def _by_torques(self) -> float | None:
        if (begun := self._begun) is None or not (self._accepted or self._moved()):
            return None
        now = self._driver.gate.counts
        return (now.torque_steps - begun.torque_steps) / max(now.steps - begun.steps, 1)

    def _touch(self, seen: Perception) -> None:
        if not seen.contacts:
            return
        table = seen.contacts
        for site, force in zip(table.site.tolist(), table.force.tolist(), strict=True):
            patch = table.sites[site].patch
            self._touched[patch] = max(force, self._touched.get(patch, 0.0))

    def _moved(self) -> dict[str, float]:
        if self._low is None:
            return {}
        ways = self._high - self._low
        order = np.argsort(-ways, kind="stable")
        servos = self._driver.robot.servos
        return {servos[i].name: float(ways[i]) for i in order.tolist() if ways[i] >= MOVED}

    def _note(self, reasons: ReasonCounter, kind: str, reason: Reason, now: float) -> None:
        if reasons.add(reason, now):
            _log.warning("%s at %.3f s, %s: %s", self._driver.robot.name, now, kind, reason)

    def _stop(self, reason: Reason | None, now: float) -> None:
        if reason is not self._stopped:  # the gate keeps the first reason
            self._stopped = reason
            _log.error("%s at %.3f s, stopped until it is reset: %s", self._driver.robot.name, now, reason)
