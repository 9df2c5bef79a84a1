"""Recordings of an earlier version are replayed, and the perceptions and decisions are equal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from helpers.golden_cases import CASES, FOLDER, perceived, replayed
from tci.reasons import NO_REASON
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import decode
from tci.recording.schemas import DECISION, TEXTS, decision_bytes

ROUNDING = 1e-9
"""Largest relative difference [1], and largest absolute difference [rad, N, m]. Processors round sums and
sines differently, and these differences accumulate in the gate's motion from period to period."""


@pytest.mark.parametrize("name", CASES)
def test_a_recording_replays_to_the_same_numbers(name: str) -> None:
    path = FOLDER / f"{name}.mcap"
    recorded = [tick.decision for tick in Recording(path).ticks() if tick.decision is not None]
    ticks = replayed(name)
    assert len(ticks) == len(recorded) > 100
    for tick, then in zip(ticks, recorded, strict=True):
        same_decision(decode(DECISION, decision_bytes(tick.sent)), then, tick.now)
    now, before = perceived(ticks), np.load(FOLDER / f"{name}.npz")
    for table in before.files:
        np.testing.assert_allclose(now[table], before[table], rtol=ROUNDING, atol=ROUNDING, err_msg=table)


def same_decision(a: dict[str, Any], b: dict[str, Any], now: float) -> None:
    """Asserts that two decisions send equal numbers in equal modes, and that both have a reason or neither
    has one. The wording of the reason may differ."""
    assert a.keys() == b.keys() | {"codes"}  # format 1 has no codes
    assert len(a["codes"]) == 1 + len(a["refusals"])
    assert (a["codes"][0] != NO_REASON) == bool(a["reason"])
    for field, value in a.items():
        if field not in b:
            continue
        said = f"{field} at {now:.3f} s"
        if field in TEXTS:
            assert bool(value) == bool(b[field]), f"{said}: {value} {b[field]}"
        elif isinstance(value, str):
            assert value == b[field], said
        else:
            np.testing.assert_allclose(value, b[field], rtol=ROUNDING, atol=ROUNDING, err_msg=said)


def test_the_recordings_hold_what_they_are_for() -> None:
    """Every recording of a touch must contain contacts and commands, and every fault must begin while the
    robot moves."""
    for name, case in CASES.items():
        contacts = np.load(FOLDER / f"{name}.npz")["contacts"]
        commands = sum(len(tick.commands) for tick in Recording(FOLDER / f"{name}.mcap").ticks())
        assert commands > 0, name
        assert (len(contacts) > 5) is (case.poke is not None), name
