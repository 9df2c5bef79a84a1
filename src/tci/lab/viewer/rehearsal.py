"""Describes one fault that a person injects, and the gate's response to this fault."""

from __future__ import annotations

from tci.gate.gate import GateState
from tci.gate.safe_command import SafeCommand
from tci.lab.faults.fault_injector import FaultPlan
from tci.lab.faults.fault_list import FAULTS
from tci.lab.faults.injectors import INJECTORS


def description(name: str) -> str:
    """Returns the text for a fault: the description, the expected response of the gate, and the delay until
    TCI can detect the fault."""
    injector = INJECTORS[name]
    late = f"; it can be detected after {injector.shows_after:g} s" if injector.shows_after else ""
    return f"{injector.description}{late}.  \nExpected: {FAULTS[injector.number].expected}"


class Rehearsal:
    """Follows one fault from a person's request to the end of the fault. One thread updates the object.
    Another thread may read `words`."""

    def __init__(self, plan: FaultPlan) -> None:
        self.plan = plan
        self.over = False
        """True after the end of the fault or of the loop."""
        self._begun: float | None = None
        self._answers: list[str] = []
        self._state = GateState.RUN

    def see(self, now: float, sent: SafeCommand, *, active: bool) -> None:
        """Records the command that is sent in the period that begins at `now` [s]. `active` is true while the
        fault is injected."""
        if self.over or not (active or self._begun is not None):
            return
        if self._begun is None:
            self._begun = now
        if sent.state is not self._state:
            self._answer(now, f"{sent.state.name}: {sent.reason}" if sent.reason else sent.state.name)
        elif sent.refusals and not sent.reason and not self._answers:
            self._answer(now, f"refused: {sent.refusals[0]}")
        self._state = sent.state
        self.over = not active

    def end(self, why: str) -> None:
        """Records that the loop ended, with the reason `why`."""
        self._answers.append(f"the loop ended: {why}")
        self.over = True

    @property
    def words(self) -> str:
        """The fault and the gate's responses, as text."""
        answers = "; ".join(self._answers)
        if not answers and self.over:
            shows = INJECTORS[self.plan.name].shows_after
            answers = "commands passed: the gate did not detect the fault"
            if shows and self.plan.lasts < shows:
                answers = f"too short to be detected: that takes {shows:g} s"
        elif not answers:
            answers = "commands pass so far" if self._begun is not None else "begins in the next period"
        return f"{self.plan.name} for {self.plan.lasts:g} s{', over' * self.over}: {answers}"

    def _answer(self, now: float, words: str) -> None:
        assert self._begun is not None  # see
        self._answers.append(f"after {1e3 * (now - self._begun):.0f} ms {words}")
