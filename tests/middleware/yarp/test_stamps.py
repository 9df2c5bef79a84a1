"""Their clock and ours."""

from __future__ import annotations

import numpy as np
import pytest

from tci.middleware.yarp.stamps import FIRST, SLEW, Offset

PERIOD = 0.01


def mapped(offset: Offset, theirs: np.ndarray, delays: np.ndarray) -> np.ndarray:
    return np.array(
        [offset.map(time, time + 100.0 + delay) for time, delay in zip(theirs, delays, strict=True)]
    )


def test_times_are_those_of_the_sender_whatever_the_way_took() -> None:
    chance = np.random.default_rng(7)
    theirs = np.arange(1000) * PERIOD
    ours = mapped(Offset(), theirs, 0.001 + chance.exponential(0.01, 1000))
    steps = np.diff(ours)[FIRST:]
    assert np.abs(steps - PERIOD).max() <= SLEW * PERIOD + 1e-9
    assert np.abs(ours[100:] - theirs[100:] - 100.0 - 0.001).max() < 0.005


def test_what_was_held_up_is_seen_to_be_old() -> None:
    offset, theirs = Offset(), np.arange(300) * PERIOD
    delays = np.full(300, 0.001)
    delays[200:] = 0.3
    ours = mapped(offset, theirs, delays)
    arrived = theirs + 100.0 + delays
    assert arrived[205] - ours[205] == pytest.approx(0.299, abs=0.01)


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_13_a_jump_of_their_clock_has_no_effect(jump: float) -> None:
    offset, ours = Offset(), []
    for number in range(400):
        now = 100.0 + number * PERIOD
        theirs = now - 50.0 + (jump if number >= 200 else 0.0)
        ours.append(now + 0.001 - offset.map(theirs, now + 0.001))
    assert np.abs(ours).max() < 0.01


def test_clocks_that_drift_are_followed() -> None:
    offset = Offset()
    for number in range(6000):
        now = number * PERIOD
        age = now + 0.001 - offset.map(now * (1 - 1e-4), now + 0.001)
    assert 0.0 <= age < 0.001
