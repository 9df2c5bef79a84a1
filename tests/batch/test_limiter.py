"""The limiter of many worlds keeps all limits and arrives as fast as ruckig, the gate's planner."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from tci.batch.limiter import BatchLimiter
from tci.gate.bounds import Bounds, bounds_of
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot

PERIOD = 0.01


@cache
def arm(name: str) -> Bounds:
    robot = load_robot(name)
    servos = [joint.servo for joint in robot.part("left_arm").servos if joint.servo is not None]
    return bounds_of(robot, servos, speed_share=0.9)[0]


def rows(bounds: Bounds) -> Array:
    return np.array([bounds.lower, bounds.upper, bounds.velocity, bounds.acceleration, bounds.jerk])


def ruckig_time(bounds: Bounds, state: Array, target: Array) -> float:
    """Time [s] of the gate's plan for an arm (n, 3): all servos arrive together."""
    count = len(target)
    given, plan = InputParameter(count), Trajectory(count)
    given.current_position, given.current_velocity, given.current_acceleration = state.T.tolist()
    given.target_position = target.tolist()
    given.target_velocity = given.target_acceleration = [0.0] * count
    given.max_velocity = bounds.velocity.tolist()
    given.max_acceleration, given.max_jerk = bounds.acceleration.tolist(), bounds.jerk.tolist()
    Ruckig(count).calculate(given, plan)
    return float(plan.duration)


@pytest.mark.parametrize("name", ["nao", "icub", "g1"])
def test_motions_keep_all_limits_and_arrive(name: str) -> None:
    """A million ticks with new targets at any time, some of them outside the limits."""
    bounds, chance, worlds = arm(name), np.random.default_rng(3), 200
    start = chance.uniform(bounds.lower, bounds.upper, (worlds, len(bounds.lower)))
    limiter, wanted = BatchLimiter(rows(bounds), start, period=PERIOD), start.copy()
    last, slack, ticks = limiter.states.copy(), 1.0 + 1e-9, 0
    reach = np.array([bounds.lower, bounds.upper])
    while ticks < 1_000_000 // 3 + 1:
        new = chance.random(wanted.shape) < 0.03
        wanted[new] = (reach[0] + (reach[1] - reach[0]) * chance.uniform(-0.1, 1.1, wanted.shape))[new]
        sent = limiter.step(wanted)
        now = limiter.states
        assert (sent >= bounds.lower - 1e-9).all()
        assert (sent <= bounds.upper + 1e-9).all()
        assert (np.abs(now[:, :, 1]) <= bounds.velocity * slack).all()
        assert (
            np.abs(np.diff([last[:, :, 1], now[:, :, 1]], axis=0)) <= bounds.acceleration * PERIOD + 1e-9
        ).all()
        assert (np.abs(now[:, :, 2]) <= bounds.acceleration * slack).all()
        assert (np.abs(now[:, :, 2] - last[:, :, 2]) <= bounds.jerk * PERIOD + 1e-6).all()
        moved = now[:, :, 0] - last[:, :, 0]  # the position goes with the speed
        assert (np.abs(moved) <= bounds.velocity * PERIOD + 1e-9).all()
        ticks += wanted.size
        last = now.copy()
    for _ in range(2000):
        limiter.step(wanted)
    assert limiter.rests.all()
    np.testing.assert_array_equal(limiter.sent, np.clip(wanted, bounds.lower, bounds.upper))


def test_motions_take_as_long_as_those_of_the_gate() -> None:
    """Ten thousand motions of an arm, half of them from a motion that goes on."""
    times: list[tuple[float, float]] = []
    for name, worlds in (("nao", 400), ("icub", 400), ("g1", 450)):
        bounds, chance = arm(name), np.random.default_rng(4)
        start = chance.uniform(bounds.lower, bounds.upper, (worlds, len(bounds.lower)))
        limiter = BatchLimiter(rows(bounds), start, period=PERIOD)
        for _ in range(8):
            wanted = chance.uniform(bounds.lower, bounds.upper, start.shape)
            before = limiter.states.copy()
            limiter.step(wanted)
            mine = PERIOD + limiter.remaining.max(axis=1)
            for w in range(worlds):
                times.append((float(mine[w]), ruckig_time(bounds, before[w], wanted[w])))
            for _ in range(8):
                limiter.step(wanted)
            rest = np.arange(1, worlds, 2)  # the others are told a new target on their way
            limiter.reset(rest, wanted[rest])
    assert len(times) == 10_000
    late = np.array([mine / its - 1.0 for mine, its in times])
    assert np.median(np.abs(late)) <= 0.01
    assert np.quantile(np.abs(late), 0.99) <= 0.05
