"""Texts that describe a fault and the gate's response to it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultPlan
from tci.lab.faults.fault_list import FAULTS
from tci.lab.faults.injectors import INJECTORS
from tci.lab.viewer.rehearsal import Rehearsal, description


def sent(state: GateState, reason: str = "", refusals: tuple[str, ...] = ()) -> Any:
    return SimpleNamespace(state=state, reason=reason, refusals=refusals)


@pytest.mark.parametrize("name", sorted(INJECTORS))
def test_a_fault_that_lasts_as_long_as_asked_for_is_not_for_ever(name: str) -> None:
    assert "for ever" not in description(name)
    assert FAULTS[INJECTORS[name].number].expected in description(name)


def test_the_answers_of_the_gate_are_told_with_their_time() -> None:
    rehearsal = Rehearsal(FaultPlan("stall", 0.0, 1.0))
    rehearsal.see(1.0, sent(GateState.RUN), active=False)
    assert rehearsal.words == "stall for 1 s: begins in the next period"
    rehearsal.see(2.0, sent(GateState.RUN), active=True)
    assert rehearsal.words == "stall for 1 s: commands pass so far"
    rehearsal.see(2.05, sent(GateState.HOLD, "too old"), active=True)
    rehearsal.see(2.06, sent(GateState.HOLD, "older"), active=True)
    rehearsal.see(2.2, sent(GateState.STOP, "does not follow"), active=True)
    rehearsal.see(3.0, sent(GateState.STOP, "does not follow"), active=False)
    assert rehearsal.over
    told = "stall for 1 s, over: after 50 ms HOLD: too old; after 200 ms STOP: does not follow"
    assert rehearsal.words == told
    rehearsal.see(4.0, sent(GateState.RUN), active=False)
    assert rehearsal.words == told


def test_a_refusal_and_the_end_of_the_loop_are_answers() -> None:
    rehearsal = Rehearsal(FaultPlan("stall", 0.0, 0.5))
    rehearsal.see(0.0, sent(GateState.RUN, refusals=("not a number",)), active=True)
    rehearsal.end("DriverError: gone")
    assert rehearsal.over
    assert "after 0 ms refused: not a number; the loop ended: DriverError: gone" in rehearsal.words
