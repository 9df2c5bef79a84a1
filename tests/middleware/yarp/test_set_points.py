"""Streams of set-points: followed without lag, ended where they ended."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest

from interface.gate_checks import Driven, make_robot, reading
from tci.frames import Array
from tci.interface.gate.bounds import bounds_of
from tci.interface.gate.limiter import Limiter
from tci.middleware.yarp import set_points
from tci.middleware.yarp.board import DIRECT, Stream
from tci.middleware.yarp.served_board import ServedBoard
from tci.middleware.yarp.set_points import ENDED, SetPoints, stopping_distance
from tci.model.catalogue import load_robot

PERIOD = 0.005
SPEED, BRAKE, JERK = 5.0, 40.0, 2000.0
STOP = 2.0**2 / (2.0 * BRAKE) + 2.0 * BRAKE / (2.0 * JERK)
"""Way to rest from 2 rad/s."""
NAO = load_robot("nao")
ARM = [servo.index for servo in NAO.servos if servo.robot_part == "LArm" and servo.limits.jerk]


def fed(points: SetPoints, values: list[float]) -> list[float]:
    here = np.array([values[:1]])
    return [float(points.lead([0], np.array([v]), here, 10.0 + n * PERIOD)[0]) for n, v in enumerate(values)]


def make() -> SetPoints:
    return SetPoints(np.array([SPEED]), np.array([BRAKE]), np.array([JERK]))


def follow(way: Array, *, period: float, lead: bool, jitter: float = 0.0) -> tuple[Array, Array, Array]:
    """NAO's arm goes `way` (n,) [rad]: angles each 2 ms where it is told so itself, and where it gets the
    set-points of somebody who is told so and sends one each `period` [s]; and where that one was last."""
    bounds, _ = bounds_of(NAO, ARM, speed_share=0.9)
    here = bounds.nearest(np.array(NAO.initial_position)[ARM], np.ones(len(ARM), dtype=bool))
    random = np.random.default_rng(0)
    told, robot = Limiter(bounds, here, 0.002), Limiter(bounds, here, 0.002)
    sender = Limiter(bounds, here, period)
    points = SetPoints(bounds.velocity, bounds.acceleration, bounds.jerk)
    for one in (told, sender):
        one.aim(here + way, bounds.velocity)
    direct, followed, due, sent = [], [], 0.0, here
    for step in range(250):
        if step * 0.002 >= due:
            sent = sender.step()
            arrived = 10.0 + due + random.uniform(0.0, jitter)
            led = points.lead(range(len(ARM)), sent, here[None], arrived) if lead else sent
            robot.aim(bounds.nearest(led, np.ones(len(ARM), dtype=bool)), bounds.velocity)
            due += period
        direct.append(told.step())
        followed.append(robot.step())
    return np.array(direct) - here, np.array(followed) - here, sent - here


WAY = np.deg2rad([6.0, 14.0, 6.0, -11.0, 0.0])[: len(ARM)]


@pytest.mark.parametrize("period", [0.005, 0.01])
def test_who_is_led_is_not_behind_its_sender_and_goes_no_farther(period: float) -> None:
    direct, followed, _ = follow(WAY, period=period, lead=True, jitter=0.001)
    _, plain, _ = follow(WAY, period=period, lead=False)

    def when(path: Array, angle: float) -> int:
        return int(np.argmax(np.abs(path[:, 1]) >= np.deg2rad(angle)))

    assert when(followed, 7.0) < when(plain, 7.0) - 5
    assert when(followed, 7.0) <= when(direct, 7.0) + 1e3 * period / 2 + 2
    if period == PERIOD:
        assert when(followed, 0.05) <= when(direct, 0.05) + 1, "it begins as if it were told itself"
        assert when(plain, 0.05) > when(direct, 0.05) + 1
    np.testing.assert_allclose(followed[-1], WAY, atol=1e-5)
    assert np.all(np.abs(followed) <= np.abs(WAY) + np.deg2rad(0.05 if period == PERIOD else 0.2))


def test_the_way_to_rest_is_that_of_the_gate() -> None:
    random = np.random.default_rng(0)
    bounds, _ = bounds_of(NAO, ARM, speed_share=0.9)
    here = bounds.nearest(np.array(NAO.initial_position)[ARM], np.ones(len(ARM), dtype=bool))
    limiter = Limiter(bounds, here, PERIOD)
    limiter.aim(here + WAY, bounds.velocity)
    for _ in range(random.integers(5, 12)):
        limiter.step()
    position, speed, rise = (row.copy() for row in limiter.state)
    limiter.halt()
    way = np.sign(speed)
    expected = way * stopping_distance(way * speed, way * rise, bounds.acceleration, bounds.jerk)
    np.testing.assert_allclose(position + expected, limiter.target, atol=1e-12)


def test_a_steady_stream_is_led_by_the_distance_of_a_stop() -> None:
    values = [2.0 * PERIOD * n for n in range(20)]
    went = np.array(fed(make(), values)) - values
    np.testing.assert_allclose(went[5:], STOP)


@pytest.mark.parametrize(
    "values",
    [[0.0] * 9 + [1.0] * 9, [0.0, 1.0] * 9, [0.0, 1.0], [0.0] * 30, [n + 0.3 * (n % 3) for n in range(30)]],
    ids=["step", "zigzag", "one", "rest", "rough"],
)
def test_what_no_limited_motion_makes_is_not_led(values: list[float]) -> None:
    assert fed(make(), values) == values


def test_joints_without_limits_are_not_led() -> None:
    never = np.array([np.nan])
    values = [2.0 * PERIOD * n for n in range(20)]
    assert fed(SetPoints(np.array([SPEED]), np.array([BRAKE]), never), values) == values


def test_a_stream_is_never_led_faster_than_its_joint_may_go() -> None:
    went = fed(make(), [float(n) for n in range(10)])
    assert went[-1] == pytest.approx(9.0 + SPEED**2 / (2 * BRAKE) + SPEED * BRAKE / (2 * JERK))


def test_a_stream_that_ends_in_the_middle_ends_at_its_last_set_point_and_says_so_once() -> None:
    points = make()
    fed(points, [2.0 * PERIOD * n for n in range(20)])
    last = 10.0 + 19 * PERIOD
    assert points.last(last + ENDED / 2) is None
    ended = points.last(last + ENDED * 1.1)
    assert ended is not None
    assert ended[0] == [0]
    assert float(ended[1][0]) == pytest.approx(2.0 * PERIOD * 19)
    assert points.last(last + ENDED * 2) is None


def test_set_points_that_come_together_are_no_faster_motion() -> None:
    points, went = make(), []
    for number in range(60):
        arrived = 10.0 + PERIOD * (number if number < 50 else 49 + (number - 49) * 1e-3)
        value = 2.0 * PERIOD * number
        went.append(float(points.lead([0], np.array([value]), np.zeros((1, 1)), arrived)[0]) - value)
    assert max(went[50:]) <= went[45] * 1.01


def test_a_stream_that_says_one_set_point_twice_goes_on_and_one_that_repeats_it_has_stopped() -> None:
    points = make()
    values = [2.0 * PERIOD * n for n in range(20)]
    went = np.array(fed(points, [*values[:15], values[14], *values[15:], values[19], values[19], values[19]]))
    led = went - [*values[:15], values[14], *values[15:], *[values[19]] * 3]
    np.testing.assert_allclose(led[8:22], STOP)
    assert led[-1] == 0.0


def test_a_stream_begins_where_its_sender_last_saw_the_joints() -> None:
    there = np.array([[0.05], [0.0]])
    step = np.array([JERK * PERIOD**3 / 6.0])
    assert step < make().lead([0], step, there, 10.0) < 4.0 * step
    assert make().lead([0], step, there[:1], 10.0) == step


def test_a_slow_motion_is_not_led_far_when_it_begins() -> None:
    """What is checked for wrong units moves slowly: a lead would be that much longer there."""
    bounds, _ = bounds_of(NAO, ARM, speed_share=0.9)
    here = bounds.nearest(np.array(NAO.initial_position)[ARM], np.ones(len(ARM), dtype=bool))
    slow, slowly = Limiter(bounds, here, PERIOD), np.full(len(ARM), np.deg2rad(2.0))
    slow.aim(here + WAY, slowly)
    points = SetPoints(bounds.velocity, bounds.acceleration, bounds.jerk)
    for number in range(40):
        told = slow.step()
        led = points.lead(range(len(ARM)), told, here[None], 10.0 + number * PERIOD)
        assert np.rad2deg(np.abs(led - told)).max() < 0.02


def test_a_robot_that_holds_is_not_led_back_to_a_set_point_from_before() -> None:
    points = make()
    fed(points, [2.0 * PERIOD * n for n in range(20)])
    points.forget()
    assert points.last(10.0 + 19 * PERIOD + ENDED * 1.1) is None
    assert fed(points, [3.0]) == [3.0], "and a new stream begins anew"


def test_whatever_streams_the_gate_keeps_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps, zigzags, noise, motions at the limits, repeats, gaps, far numbers (`make soak` runs more)."""
    cycles = int(os.environ.get("TCI_SOAK", "6000"))
    random = np.random.default_rng(11)
    driven = Driven(make_robot(), [0.0] * 6)
    monkeypatch.setattr(set_points, "time", SimpleNamespace(monotonic=lambda: 10.0 + driven.time))
    board = ServedBoard("arm", driven.robot.servos)
    board.set_modes(None, [DIRECT] * 6)
    bounds, _ = bounds_of(driven.robot, range(6), speed_share=1.0)
    sender, told, kind, every = Limiter(bounds, np.zeros(6), PERIOD), np.zeros(6), 0, 3
    led = 0
    for cycle in range(cycles):
        if cycle % 150 == 0:
            kind, every = int(random.integers(6)), int(random.integers(1, 9))
            sender.aim(bounds.nearest(random.uniform(-3.0, 3.0, 6), np.ones(6, dtype=bool)), bounds.velocity)
        if cycle % every == 0 and random.random() < 0.95:
            told = sender.step() if kind in (0, 1) else told
            if kind == 1:
                told = told + random.normal(0.0, 1e-4, 6)
            elif kind > 1 and random.random() < 0.9:
                told = told + random.choice([1e-5, 1e-2, 1.0]) * random.normal(size=6)
            if kind == 5 and random.random() < 0.1:
                told = random.choice([-1.0, 1.0], 6) * 1e12
            group = [0, 3, 4] if kind == 4 else list(range(6))
            board.stream(Stream.POSITION, group, np.rad2deg(told[group]).tolist())
        if random.random() < 0.002:
            driven.gate.hold("for a test")
        board.mind()
        safe = driven.step(*board.book.take())
        board.book.judge(safe.orders, safe.refusals)
        board.see(reading(driven.angles, driven.time), driven.gate.modes)
        if safe.reason:
            board.held()
        led += bool(np.any(board._set_points._stream[3]))
        if cycle % 5000 == 4999:
            driven.assert_within_limits()
            del driven.path[:-3]
    driven.assert_within_limits()
    assert led > cycles / 20
