"""Conversion of a sender's time stamps to this process's clock."""

from __future__ import annotations

import numpy as np
import pytest

from tci.drivers.remote.source_clock import FIRST, SLEW, SourceClock

PERIOD = 0.01


def placed(clock: SourceClock, stamp: float, arrival: float) -> float:
    found = clock.place(stamp, arrival)
    assert found is not None
    return found


def mapped(clock: SourceClock, theirs: np.ndarray, delays: np.ndarray) -> np.ndarray:
    return np.array(
        [placed(clock, time, time + 100.0 + delay) for time, delay in zip(theirs, delays, strict=True)]
    )


def test_times_are_those_of_the_sender_whatever_the_way_took() -> None:
    chance = np.random.default_rng(7)
    theirs = np.arange(1000) * PERIOD
    ours = mapped(SourceClock(), theirs, 0.001 + chance.exponential(0.01, 1000))
    steps = np.diff(ours)[FIRST:]
    assert np.abs(steps - PERIOD).max() <= SLEW * PERIOD + 1e-9
    assert np.abs(ours[100:] - theirs[100:] - 100.0 - 0.001).max() < 0.005


@pytest.mark.parametrize("held", [0.3, 3.0])
def test_what_was_held_up_is_seen_to_be_old(held: float) -> None:
    clock, theirs = SourceClock(), np.arange(300) * PERIOD
    delays = np.full(300, 0.001)
    delays[200:] = held
    ours = mapped(clock, theirs, delays)
    arrived = theirs + 100.0 + delays
    assert arrived[205] - ours[205] == pytest.approx(held, abs=0.01)


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_13_a_jump_of_their_clock_has_no_effect(jump: float) -> None:
    clock, ours = SourceClock(), []
    for number in range(400):
        now = 100.0 + number * PERIOD
        theirs = now - 50.0 + (jump if number >= 200 else 0.0)
        ours.append(now + 0.001 - placed(clock, theirs, now + 0.001))
    assert np.abs(ours).max() < 0.01


def test_clocks_that_drift_are_followed() -> None:
    clock = SourceClock()
    for number in range(6000):
        now = number * PERIOD
        age = now + 0.001 - placed(clock, now * (1 - 1e-4), now + 0.001)
    assert 0.0 <= age < 0.001


def test_what_is_out_of_order_or_comes_again_has_no_time_and_no_stamp_means_now() -> None:
    clock = SourceClock()
    assert clock.place(5.0, 100.0) == 100.0
    assert clock.place(5.0, 100.01) is None
    assert clock.place(4.5, 100.02) is None
    assert clock.place(0.0, 100.03) == 100.03
    assert clock.place(float("nan"), 100.04) == 100.04
