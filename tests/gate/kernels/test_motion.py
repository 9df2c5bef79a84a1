"""The compiled checks of servo motion give the same results as simple rules in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from tci.gate.kernels import motion as at
from tci.messages.frames import Array

SETTINGS = at.Settings(0.1, 0.1, 0.05, 0.04, 0.05, 0.06, 0.03, 0.5, 0.3, 0.05)


def since(begin: Array, holds: Array, now: float) -> Array:
    begin[:] = np.where(holds, np.minimum(begin, now), np.inf)
    return now - begin


def oracle(
    judged: Array, now: Array, before: Array, position: Array, velocity: Array, lags: Array, stamp: float,
    elapsed: float, memory: at.Motions,
) -> tuple[int, int]:  # fmt: skip
    """Returns the fault and the servo with the fault, for servos that are all commanded."""
    following, lag, patience, opposing, least, repeat, travel = SETTINGS[:7]
    error = np.abs(position - now)
    lasted = since(memory.late_since, judged & (error > following + lag * np.abs(velocity)), stamp)
    if (lasted > patience).any():
        return at.LATE, int(np.argmax(lasted))
    speed = (now - before) / elapsed
    against = judged & (velocity * speed < 0.0) & (np.minimum(np.abs(speed), np.abs(velocity)) > least)
    memory.rose[velocity > least], memory.fell[velocity < -least] = stamp, stamp
    against &= stamp - elapsed - np.where(speed > 0.0, memory.rose, memory.fell) > lags
    lasted = since(memory.opposed_since, against, stamp)
    if (lasted > opposing).any():
        return at.OPPOSED, int(np.argmax(lasted))
    repeats = judged & (now == before)
    begins = ~(repeats & np.isfinite(memory.repeats_since))
    memory.origin[begins] = position[begins]
    since(memory.repeats_since, repeats, stamp)
    way = np.abs(position - memory.origin)
    lasted = since(memory.left_since, repeats & (way > 0.5 * travel), stamp)
    frozen = (lasted > repeat) & (way > travel)
    return (at.FROZEN, int(np.argmax(frozen))) if frozen.any() else (at.FOLLOWS, -1)


@pytest.mark.parametrize("seed", range(20))
def test_it_finds_what_numpy_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    n, step = 6, 0.01
    judged = random.random(n) < 0.8
    never, lags = np.full((4, n), np.inf), random.choice([0.0, 0.03, 0.2], n)
    memories = [at.Motions(*never[:2].copy(), *-never[2:], *never[2:].copy(), np.zeros(n)) for _ in range(3)]
    servos, worst, found = np.arange(n), np.zeros(2), set()
    measured, position, velocity = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(1, 400):
        if k % 10 == 0:
            velocity = random.choice([0.0, 0.3, -0.3, 1.0], n)
            moving = random.choice([1.0, 1.0, 0.0, -1.0, 0.5], n)
        position = position + step * velocity
        before, measured = measured, measured + (step * velocity * moving if k >= 10 else 0.0)
        wanted = oracle(judged, measured, before, position, velocity, lags, step * k, step, memories[0])
        readings = at.Readings(measured, velocity, before, velocity)
        kinds = at.Kinds(judged, judged)
        sent = at.Sent(position, velocity)
        seen = (servos, kinds, readings, sent, lags, SETTINGS, step * k, step)
        plain = np.zeros(2)
        in_python = at.judge_motion.py_func(*seen, memories[2], plain)
        got = at.judge_motion(*seen, memories[1], worst)
        assert got == wanted[0], k
        np.testing.assert_array_equal(*memories[:2])
        assert got == in_python
        np.testing.assert_array_equal(*memories[1:])
        if got != at.FOLLOWS:
            assert worst[0] == plain[0] == wanted[1]
            measured, position = np.zeros(n), np.zeros(n)
        found.add(got)
    assert len(found) > 1


LIMITS = at.Limits(np.full(6, 2.0), np.full(6, np.inf))


def velocity_oracle(
    judged: Array, loose: Array, readings: at.Readings, unanswered: Array, elapsed: float, memory: at.Drifts,
) -> tuple[int, int]:  # fmt: skip
    """Returns the fault and the servo with the fault, for servos that are all commanded."""
    following, lag, _, _, least, _, _, forgets, push = SETTINGS[:9]
    now, speed, before, speed_before = readings
    mean, change = 0.5 * (speed + speed_before), now - before
    known = ~judged & np.isfinite(mean) & (elapsed <= at.SELDOM)
    moves = (np.abs(speed) > least) | (loose & (np.abs(change) / elapsed > least))
    drift = max(1.0 - elapsed / forgets, 0.0) * memory.drift
    memory.drift[:] = np.where(known, drift + np.where(moves, mean * elapsed - change, 0.0), 0.0)
    drift = np.abs(memory.drift)
    with np.errstate(invalid="ignore"):
        far = drift > following + lag * np.abs(speed)
    if far.any():
        return at.DISAGREES, int(np.argmax(np.where(far, drift, -1.0)))
    share = np.where(loose, unanswered / LIMITS.torque, 0.0)
    return (at.DEAF, int(np.argmax(share))) if (share > push).any() else (at.FOLLOWS, -1)


@pytest.mark.parametrize("seed", range(20))
def test_it_finds_what_numpy_finds_of_velocities(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = 6
    judged = random.random(n) < 0.2
    loose = ~judged & (random.random(n) < 0.7)
    fresh = np.zeros((1, n))
    memories, found, stamp = [at.Drifts(*fresh.copy()) for _ in range(3)], set(), 0.0
    measured = speed = torque = true = np.zeros(n)
    sensed = told = np.ones(n)
    for k in range(1, 600):
        if k % 15 == 0:
            true = random.choice([0.0, 0.04, 0.5, -0.5, 2.0], n)
            sensed = random.choice([1.0, 1.0, 0.0, -1.0], n)
            told = random.choice([1.0, 1.0, 1.0, 0.0, np.nan], n)
        if k % 4 == 0:
            torque = np.where(random.random(n) < 0.02, random.uniform(0.0, 2.0, n), 0.0)
        elapsed = float(random.choice([0.01, 0.012, 0.03], p=[0.7, 0.28, 0.02]))
        stamp += elapsed
        before, measured = measured, measured + elapsed * sensed * true
        speed_before, speed = speed, told * true
        readings = at.Readings(measured, speed, before, speed_before)
        wanted = velocity_oracle(judged, loose, readings, torque, elapsed, memories[0])
        kinds = at.Kinds(judged, loose)
        seen = (np.arange(n), kinds, readings, torque, LIMITS, SETTINGS, elapsed)
        worst, plain = np.zeros(2), np.zeros(2)
        got = at.judge_velocity(*seen, memories[1], worst)
        in_python = at.judge_velocity.py_func(*seen, memories[2], plain)
        assert got == in_python == wanted[0], k
        for memory in memories[1:]:
            np.testing.assert_allclose(memory, memories[0], rtol=1e-12, atol=1e-15)
        if got != at.FOLLOWS:
            assert worst[0] == plain[0] == wanted[1]
            for memory in memories:
                for kept, new in zip(memory, fresh, strict=True):
                    kept[:] = new
        found.add(got)
    assert {at.DISAGREES, at.FOLLOWS, at.DEAF} <= found


@pytest.mark.parametrize("elapsed", [0.0, 0.01, 0.03])
def test_a_reading_is_noted_and_an_angle_that_jumps_is_found(elapsed: float) -> None:
    random = np.random.default_rng(1)
    count, found = 4, set()
    fastest = np.array([1.0, 1.0, np.inf, 1.0])
    limits = at.Limits(np.full(count, 2.0), fastest)
    readings, worst = at.Readings(*np.zeros((4, count))), np.zeros(2)
    motions, drifts = at.Motions(*np.full((7, count), np.inf)), at.Drifts(np.zeros(count))
    been, commanded = at.Been(*np.zeros((2, count))), np.array([0, 2])
    been.low[:], been.high[:] = np.inf, -np.inf
    low, high = been.low.copy(), been.high.copy()
    kinds, sent = at.Kinds(np.ones(2, bool), np.zeros(2, bool)), at.Sent(*np.zeros((2, 2)))
    none = commanded, kinds, sent, np.zeros(2), np.zeros(count)
    for _ in range(60):
        before, speed_before = readings.angle.copy(), readings.speed.copy()
        angles = before + random.choice([0.0, 0.055, -0.065, 0.2], count)
        speeds = random.normal(size=count)
        monitor = at.Monitor(limits, SETTINGS, readings, been, motions, drifts, worst)
        got = at.judge_reading(monitor, *none, angles, speeds, 1.0, elapsed)
        assert np.array(readings).tolist() == np.array([angles, speeds, before, speed_before]).tolist()
        low, high = np.minimum(before, low + 0.05 * elapsed), np.maximum(before, high - 0.05 * elapsed)
        low[commanded] = high[commanded] = before[commanded]
        change = np.abs(angles - np.clip(angles, low, high))  # where it was it may be again
        beyond = change - (fastest * max(elapsed, 1e-9) + 0.05)
        led = 0.5 * (speeds + speed_before) * elapsed  # the way that the velocity tells
        lost = (elapsed > 0.025) & (change <= 4.0 * fastest * max(elapsed, 1e-9) + 0.05)
        ends = np.where(lost, np.sort([speeds * elapsed, speed_before * elapsed], axis=0), led)
        beyond[(angles - before >= ends[0] - 0.05) & (angles - before <= ends[1] + 0.05)] = -1.0
        jumped = elapsed > 0.0 and bool((beyond > 0.0).any())
        assert got == (at.JUMPED if jumped else at.FOLLOWS)
        if jumped:
            assert worst.tolist() == [np.argmax(beyond), change[np.argmax(beyond)]]
        found.add(got)
    assert found == ({at.JUMPED, at.FOLLOWS} if elapsed else {at.FOLLOWS})
