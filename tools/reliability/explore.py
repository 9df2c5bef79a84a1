"""Long random exploration of the loop with all events and faults."""

from __future__ import annotations

import threading

from pool import Result, gather
from row import Row

from helpers.explorer import NAMES, Explorer
from tci.gate.gate import GateState

TRANSITIONS = {
    (GateState.RUN, GateState.HOLD),
    (GateState.RUN, GateState.STOP),
    (GateState.HOLD, GateState.RUN),
    (GateState.HOLD, GateState.STOP),
    (GateState.STOP, GateState.RUN),
    (GateState.STOP, GateState.HOLD),
}
RARE = {(GateState.HOLD, GateState.STOP), (GateState.STOP, GateState.HOLD)}
"""Transitions that may be missing in few episodes."""
EPISODES, FEW = 20, 12
"""Number of episodes of one seed, and at CI size."""


def loop(full: bool) -> Row:
    """Counts the violated invariants, and the transitions and faults that occurred."""
    jobs = [(seed, EPISODES) for seed in range(100)] if full else [(1, FEW)]
    done = gather("loop", _one, jobs, full=full)
    broken = [words for seen in done for words in seen["broken"]]
    transitions = {tuple(pair) for seen in done for pair in seen["transitions"]}
    missing = {(a.value, b.value) for a, b in TRANSITIONS} - transitions
    rare = {(a.value, b.value) for a, b in RARE}
    faults = {name for seen in done for name in seen["faults"]}
    return Row(
        "random exploration of the control loop",
        sum(seen["steps"] for seen in done),
        1e6,
        "steps",
        f"{len(broken)} invariants violated; {len(TRANSITIONS) - len(missing)} of {len(TRANSITIONS)} "
        f"transitions and {len(faults & {*NAMES})} of {len(NAMES)} faults occurred",
        "0 invariants violated, every transition occurs",
        not broken and (not done or (not missing and faults >= set(NAMES) if full else missing <= rare)),
    )


def _one(seed: int, episodes: int) -> Result:
    threading.excepthook = lambda told: None  # a fault that makes a thread fail is intended
    explorer = Explorer(seed)
    for _ in range(episodes):
        explorer.episode()
    seen = explorer.seen
    return {
        "steps": seen.steps,
        "broken": seen.broken,
        "transitions": [(a.value, b.value) for a, b in seen.transitions],
        "faults": [*seen.faults],
    }
