"""The compiled look at servos' motion, against the same rules in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from tci.frames import Array
from tci.interface.kernels import motion as at

SETTINGS = np.array([0.1, 0.1, 0.05, 0.04, 0.05, 0.06, 0.03])


def since(begin: Array, holds: Array, now: float) -> Array:
    begin[:] = np.where(holds, np.minimum(begin, now), np.inf)
    return now - begin


def oracle(
    judged: Array, now: Array, before: Array, position: Array, velocity: Array, stamp: float, elapsed: float,
    memory: Array,
) -> tuple[int, int]:  # fmt: skip
    """What was found and where, for servos that are all under command."""
    following, lag, patience, opposing, least, repeat, travel = SETTINGS
    error = np.abs(position - now)
    lasted = since(memory[0], judged & (error > following + lag * np.abs(velocity)), stamp)
    if (lasted > patience).any():
        return at.LATE, int(np.argmax(lasted))
    speed = (now - before) / elapsed
    against = judged & (velocity * speed < 0.0) & (np.minimum(np.abs(speed), np.abs(velocity)) > least)
    lasted = since(memory[1], against, stamp)
    if (lasted > opposing).any():
        return at.OPPOSED, int(np.argmax(lasted))
    repeats = judged & (now == before)
    begins = ~(repeats & np.isfinite(memory[2]))
    memory[3][begins] = position[begins]
    lasted = since(memory[2], repeats, stamp)
    frozen = (lasted > repeat) & (np.abs(position - memory[3]) > travel)
    return (at.FROZEN, int(np.argmax(frozen))) if frozen.any() else (at.FOLLOWS, -1)


@pytest.mark.parametrize("seed", range(20))
def test_it_finds_what_numpy_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    n, step = 6, 0.01
    judged = random.random(n) < 0.8
    memories = [np.full((4, n), np.inf) for _ in range(3)]
    for memory in memories:
        memory[at.ORIGIN] = 0.0
    servos, worst, found = np.arange(n), np.zeros(2), set()
    measured, position, velocity = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(1, 400):
        if k % 10 == 0:
            velocity = random.choice([0.0, 0.3, -0.3, 1.0], n)
            moving = random.choice([1.0, 1.0, 0.0, -1.0, 0.5], n)
        position = position + step * velocity
        before, measured = measured, measured + (step * velocity * moving if k >= 10 else 0.0)
        wanted = oracle(judged, measured, before, position, velocity, step * k, step, memories[0])
        seen = (servos, judged, measured, before, position, velocity, SETTINGS, step * k, step)
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


def test_the_largest_change_is_numpy_s() -> None:
    random = np.random.default_rng(1)
    for count in (0, 1, 7):
        now, before = random.normal(size=(2, count))
        for find in (at.largest_change, at.largest_change.py_func):
            assert find(now, before) == np.abs(now - before).max(initial=0.0)
