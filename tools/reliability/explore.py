"""The loop with anything that may happen to it, for long."""

from __future__ import annotations

import threading

from pool import spread
from row import Row

from runtime.explorer import NAMES, Explorer, Seen
from tci.interface.gate import GateState

TRANSITIONS = {
    (GateState.RUN, GateState.HOLD),
    (GateState.RUN, GateState.STOP),
    (GateState.HOLD, GateState.RUN),
    (GateState.HOLD, GateState.STOP),
    (GateState.STOP, GateState.RUN),
    (GateState.STOP, GateState.HOLD),
}
EPISODES = 20
"""Episodes of one seed."""


def loop(full: bool) -> Row:
    """Invariants broken, transitions and faults seen."""
    done = spread(_one, [(seed,) for seed in range(90 if full else 1)], "exploring the loop")
    steps = sum(seen.steps for seen in done)
    broken = [words for seen in done for words in seen.broken]
    transitions = TRANSITIONS & {pair for seen in done for pair in seen.transitions}
    faults = {name for seen in done for name in seen.faults}
    return Row(
        "stateful exploration of the loop",
        f"{steps} steps",
        f"{len(broken)} broken; {len(transitions)} of {len(TRANSITIONS)} transitions; {len(faults)} faults",
        "1e6 steps, 0 broken, every transition seen",
        not broken and (not full or (transitions == TRANSITIONS and faults >= set(NAMES))),
    )


def _one(seed: int) -> Seen:
    threading.excepthook = lambda told: None  # the fault that makes a thread fail is on purpose
    explorer = Explorer(seed)
    for _ in range(EPISODES):
        explorer.episode()
    return explorer.seen
