"""Random exploration finds no violated invariant of loop and gate."""

from __future__ import annotations

import pytest

from helpers.explorer import Explorer
from tci.gate.gate import GateState


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_no_fault_and_no_command_breaks_an_invariant_and_every_transition_is_seen() -> None:
    explorer = Explorer(seed=1)
    for _ in range(12):
        explorer.episode()
    assert explorer.seen.broken == []
    assert set(explorer.seen.transitions) >= {
        (GateState.RUN, GateState.HOLD),
        (GateState.HOLD, GateState.RUN),
        (GateState.RUN, GateState.STOP),
        (GateState.STOP, GateState.RUN),
    }
