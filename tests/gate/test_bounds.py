"""Velocity-controlled servos can always stop before their limits, according to the formula of the stopping
distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tci.gate.bounds import APPROACH, MARGIN, Bounds
from tci.messages.frames import Array

FREE = Bounds(
    lower=np.array([-1.0, -0.5, -2.0]),
    upper=np.array([2.0, 0.7, 3.0]),
    velocity=np.full(3, 9.0),
    acceleration=np.array([40.0, 20.0, 10.0]),
    jerk=np.array([4000.0, 500.0, 300.0]),
    coupling=np.zeros((0, 3)),
    coupling_lower=np.zeros(0),
    coupling_upper=np.zeros(0),
)
TIED = replace(
    FREE,
    lower=np.full(3, -9.0),
    upper=np.full(3, 9.0),
    coupling=np.array([[2.0, -1.0, 0.0]]),
    coupling_lower=np.array([-0.6]),
    coupling_upper=np.array([0.9]),
)


PERIOD = 0.005


def stop(speed: Array | float, acceleration: Array | float, jerk: Array | float) -> Array:
    """Returns the distance [rad] of a stop from `speed` [rad/s] whose deceleration increases and decreases
    linearly, after two periods and the time that an acceleration takes to end."""
    a, j = APPROACH * np.asarray(acceleration), APPROACH * np.asarray(jerk)
    way: Array = speed**2 / (2 * a) + speed * (1.5 * a / j + 2.0 * PERIOD)
    return way


def allowed(bounds: Bounds, position: Array, velocity: Array) -> Array:
    return bounds.allowed_velocity(position, velocity, PERIOD)


@pytest.mark.parametrize("room", [0.5, 0.1, 1e-3, 1e-5])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_servo_is_as_fast_as_it_can_stop_before_its_limit(way: float, room: float) -> None:
    position = FREE.upper - room if way > 0 else FREE.lower + room
    speed = allowed(FREE, position, np.full(3, 9.0 * way))
    assert np.all(speed * way > 0.0)
    assert stop(np.abs(speed), FREE.acceleration, FREE.jerk) == pytest.approx(room - MARGIN, rel=1e-9)
    # Far from the limit there is room to stop, and the velocity of a servo that is slow enough is not
    # reduced.
    assert allowed(FREE, position, np.full(3, -0.4 * way)) == pytest.approx(np.full(3, -0.4 * way))
    assert allowed(FREE, position, 0.9 * speed) == pytest.approx(0.9 * speed)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_at_a_limit_and_beyond_nothing_goes_outward(way: float) -> None:
    edge = FREE.upper if way > 0 else FREE.lower
    for beyond in (0.0, 0.2):
        assert not allowed(FREE, edge + way * beyond, np.full(3, 0.3 * way)).any()
        assert allowed(FREE, edge + way * beyond, np.full(3, -0.3 * way)) == pytest.approx(-0.3 * way)


def test_a_range_that_is_narrower_than_the_margins_is_shared_out() -> None:
    width = 1e-6
    narrow = replace(FREE, lower=np.full(3, 0.4), upper=np.full(3, 0.4 + width))
    speed = allowed(narrow, np.full(3, 0.4), np.ones(3))
    assert stop(speed, FREE.acceleration, FREE.jerk) == pytest.approx(width / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("position", "velocity", "room"),
    [
        ([0.3, 0.0, 0.0], [3.0, -2.0, 1.5], 0.9 - 0.6),
        ([0.44, 0.0, 0.0], [1.7, 0.5, -2.0], 0.9 - 0.88),
        ([-0.1, 0.3, 0.0], [-3.0, 1.0, 1.5], 0.6 - 0.5),
        ([0.1, 0.0, 5.0], [0.0, 9.0, 0.1], 0.6 + 0.2),
    ],
)
def test_who_would_leave_a_coupling_slows_down_together(
    position: list[float], velocity: list[float], room: float
) -> None:
    here, asked = np.array(position), np.array(velocity)
    speed = allowed(TIED, here, asked)
    rate = abs(2.0 * speed[0] - speed[1])
    assert stop(rate, 2.0 * 40.0 + 20.0, 2.0 * 4000.0 + 500.0) == pytest.approx(room - MARGIN, rel=1e-9)
    assert speed[0] * asked[1] == pytest.approx(speed[1] * asked[0])
    assert np.all(speed[:2] * asked[:2] >= 0.0)
    assert speed[2] == asked[2]


def test_where_no_coupling_is_near_nobody_slows_down() -> None:
    velocity = np.array([0.3, 0.4, -0.5])
    assert allowed(TIED, np.zeros(3), velocity) == pytest.approx(velocity)


def test_only_the_servos_of_a_coupling_that_is_near_slow_down() -> None:
    two = replace(
        TIED,
        coupling=np.array([[2.0, -1.0, 0.0], [0.0, 1.0, 1.0]]),
        coupling_lower=np.array([-0.6, -0.2]),
        coupling_upper=np.array([0.9, 0.3]),
    )
    velocity = np.array([0.3, 0.8, 0.7])
    speed = allowed(two, np.array([0.1, 0.1, 0.15]), velocity)
    assert stop(speed[1] + speed[2], 30.0, 800.0) == pytest.approx(0.05 - MARGIN, rel=1e-9)
    assert speed[0] == 0.3


def test_the_nearest_point_to_a_target_beyond_a_coupling_lies_on_its_edge() -> None:
    everyone = np.full(3, True)
    for target, edge in (([1.0, 0.3, 0.2], 0.9 - MARGIN), ([-1.0, 0.3, 0.2], -0.6 + MARGIN)):
        point = TIED.nearest(np.array(target), everyone)
        assert 2.0 * point[0] - point[1] == pytest.approx(edge, abs=1e-12)
        moved = point - target
        assert moved[0] == pytest.approx(-2.0 * moved[1], abs=1e-12), "at a right angle"
        assert moved[2] == 0.0


@pytest.mark.parametrize(("beyond", "stays"), [(0.4, True), (0.6, False), (1.9, False)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_target_within_half_the_margin_of_a_coupling_counts_as_inside(
    way: float, beyond: float, stays: bool
) -> None:
    edge = 0.9 - MARGIN if way > 0 else -0.6 + MARGIN
    target = np.array([(edge + way * beyond * MARGIN) / 2.0, 0.0, 0.0])
    point = TIED.nearest(target, np.full(3, True))
    assert np.array_equal(point, target) == stays
    assert stays or 2.0 * point[0] - point[1] == pytest.approx(edge, abs=1e-12)


def test_narrow_limits_and_couplings_leave_their_middle() -> None:
    width, everyone = 1e-6, np.full(3, True)
    narrow = replace(TIED, lower=np.full(3, 0.1), upper=np.full(3, 0.1 + width))
    assert narrow.nearest(np.ones(3), everyone) == pytest.approx(0.1 + width / 2, abs=1e-12)
    tight = replace(TIED, coupling_lower=np.array([0.4]), coupling_upper=np.array([0.4 + width]))
    for target in (np.ones(3), -np.ones(3)):
        point = tight.nearest(target, everyone)
        assert 2.0 * point[0] - point[1] == pytest.approx(0.4 + width / 2, abs=1e-12)


def test_where_the_others_leave_no_point_it_is_as_close_as_the_limits_allow() -> None:
    """Only the first servo may move. The second servo is not commanded, and is too far outside the coupling's
    bounds."""
    first = np.array([True, False, False])
    short = replace(TIED, lower=np.array([-0.2, -9.0, -9.0]), upper=np.array([0.2, 9.0, 9.0]))
    for far, limit in ((-4.0, -0.2 + MARGIN), (4.0, 0.2 - MARGIN)):
        target = np.array([0.0, far, 0.3])
        assert short.nearest(target, first) == pytest.approx([limit, far, 0.3], abs=1e-12)


@pytest.mark.parametrize("angle", [-1.0, 0.3, 2.0])
def test_a_servo_whose_limits_are_equal_stays_exactly_there(angle: float) -> None:
    """Half of the range is smaller than the margin."""
    fixed = replace(FREE, lower=np.full(3, angle), upper=np.full(3, angle))
    for away in (-0.5, 0.0, 0.5):
        assert fixed.inside(np.full(3, angle + away)).tolist() == [angle] * 3
        assert not allowed(fixed, np.full(3, angle), np.full(3, away)).any()


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_outside_a_range_that_is_narrower_than_the_margins_its_middle_is_nearest(way: float) -> None:
    narrow = replace(FREE, lower=np.zeros(3), upper=np.full(3, MARGIN))
    assert narrow.inside(np.full(3, way)) == pytest.approx(np.full(3, MARGIN / 2), rel=1e-6)


def test_an_angle_at_its_limit_is_inside() -> None:
    assert np.array_equal(FREE.inside(FREE.upper), FREE.upper)
    assert np.array_equal(FREE.inside(FREE.lower), FREE.lower)
    assert np.array_equal(FREE.inside(FREE.upper + 0.1), FREE.upper - MARGIN)
    assert np.array_equal(FREE.inside(FREE.lower - 0.1), FREE.lower + MARGIN)
