"""The compiled checks of a stop agree with the sampled stop."""

from __future__ import annotations

import numpy as np
from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization, Trajectory

from tci.gate.kernels.stops import is_outside, stop_stays_inside, take_room

COUNT = 5


def test_the_span_is_what_the_stop_passes_through_and_limits_are_judged_by_it() -> None:
    random = np.random.default_rng(4)
    otg, plan, stop = Ruckig(COUNT), InputParameter(COUNT), Trajectory(COUNT)
    plan.control_interface, plan.synchronization = ControlInterface.Velocity, Synchronization.No
    plan.target_velocity = [0.0] * COUNT
    turned = outside = 0
    for _ in range(400):
        start = random.normal(size=(3, COUNT)) * [[1.0], [1.0], [15.0]]
        jerk = random.uniform(100.0, 1000.0, COUNT)
        plan.current_position, plan.current_velocity, plan.current_acceleration = start.tolist()
        plan.max_velocity, plan.max_acceleration, plan.max_jerk = [9.0] * COUNT, [60.0] * COUNT, jerk.tolist()
        otg.calculate(plan, stop)
        times = np.linspace(0.0, stop.duration, 3000)
        path = np.array([stop.at_time(time)[0] for time in times.tolist()])
        span, end = np.empty((2, COUNT)), path[-1]
        lower, upper = start[0] - 0.02, start[0] + 0.02
        inside = stop_stays_inside(start, end, jerk, start[0], lower, upper, span)
        assert np.abs(span[0] - path.min(axis=0)).max() < 1e-4
        assert np.abs(span[1] - path.max(axis=0)).max() < 1e-4
        assert inside == bool(np.all((span[0] >= lower) & (span[1] <= upper)))
        turned += bool(np.any((span[0] < np.minimum(start[0], end)) | (span[1] > np.maximum(start[0], end))))
        outside += not inside
    assert turned > 100
    assert 0 < outside < 400


def test_who_begins_outside_may_stay_there_and_a_number_that_is_none_never_may() -> None:
    start, span = np.array([[2.0], [0.0], [0.0]]), np.empty((2, 1))
    lower, upper, jerk = np.array([-1.0]), np.array([1.0]), np.array([10.0])
    assert stop_stays_inside(start, start[0], jerk, start[0], lower, upper, span)
    assert not stop_stays_inside(start, start[0] + 1e-3, jerk, start[0], lower, upper, span)
    for row in range(3):
        bad = start.copy()
        bad[row] = np.nan
        assert not stop_stays_inside(bad, start[0], jerk, start[0], lower, upper, span)
    assert not stop_stays_inside(start, np.array([np.nan]), jerk, start[0], lower, upper, span)


def test_what_came_inside_does_not_leave_again() -> None:
    span, jerk = np.empty((2, 1)), np.array([100.0])
    lower, upper = np.array([-1.0]), np.array([1.0])
    # The motion begins outside, its speed takes it inside, and its acceleration back outside.
    here, start = np.array([1.01]), np.array([[1.005], [-0.3], [9.0]])
    assert not stop_stays_inside(start, np.array([1.004]), jerk, here, lower, upper, span)
    assert span[0, 0] < 1.0
    assert stop_stays_inside(start, np.array([0.999]), jerk, here, lower, upper, span)
    # A stop that stays outside may turn back, but not farther outside than its start.
    start = np.array([[1.005], [-0.01], [2.0]])
    assert stop_stays_inside(start, np.array([1.006]), jerk, here, lower, upper, span)
    assert span[0, 0] > 1.0
    assert not stop_stays_inside(start, np.array([1.02]), jerk, here, lower, upper, span)


def test_one_angle_outside_is_outside() -> None:
    lower, upper = np.array([-1.0, 0.0]), np.array([1.0, 0.5])
    assert not is_outside(np.array([-1.0, 0.5]), lower, upper)
    for here in ([-1.1, 0.2], [1.1, 0.2], [0.0, -0.1], [0.0, 0.6]):
        assert is_outside(np.array(here), lower, upper)


def test_room_is_taken_on_the_side_where_a_servo_is_away() -> None:
    measured, box = np.array([0.5, 0.0, -0.5, 2.0]), np.zeros((2, 4))
    span = np.array([[0.1, 0.2, 1.0], [0.4, 0.3, 1.5]])
    take_room(np.array([0, 2, 3]), measured, np.array([0.25, 0.25, 2.0]), span, box)
    assert box.tolist() == [[0.1, 0.0, -0.55, 1.0], [0.65, 0.0, 0.3, 1.5]]
