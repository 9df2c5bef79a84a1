"""Planned stops and the ranges of angles on their paths equal those of ruckig in velocity control."""

from __future__ import annotations

import numpy as np
import pytest
from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization, Trajectory

from tci.gate.kernels import stops as at
from tci.gate.kernels.stops import follow_stop, plan_stop, take_room
from tci.messages.frames import Array

COUNT = 5
NO_COUPLING = np.zeros((0, COUNT)), np.zeros(0), np.zeros(0)


def planned(
    state: Array, here: Array, lower: Array, upper: Array, jerk: Array, *, most: float = 60.0
) -> tuple[at.Stop, bool, bool, float]:
    """Returns a planned stop without couplings, True if it stays inside the bounds, True if it
    starts outside, and its duration [s]."""
    limits, stop = at.Limits(lower, upper, np.full(len(here), most), jerk), at.empty_stop(len(here))
    inside, keeps, outside, duration = plan_stop(
        state, here, limits, np.zeros((0, len(here))), np.zeros(0), np.zeros(0), stop
    )
    assert keeps
    return stop, inside, outside, duration


def test_a_stop_is_the_one_that_ruckig_plans_and_its_span_is_what_it_passes_through() -> None:
    random = np.random.default_rng(4)
    otg, plan, stop = Ruckig(COUNT), InputParameter(COUNT), Trajectory(COUNT)
    plan.control_interface, plan.synchronization = ControlInterface.Velocity, Synchronization.No
    plan.target_velocity = [0.0] * COUNT
    turned = outside = plateaus = 0
    for case in range(600):
        start = random.normal(size=(3, COUNT)) * [[1.0], [1.0], [15.0]]
        start[1:] *= random.random((2, COUNT)) < 0.9  # some servos are at rest, or have a constant velocity
        most = 60.0 if case % 2 else 9.0  # 9 is less than some accelerations at the start
        jerk = random.uniform(100.0, 1000.0, COUNT)
        plan.current_position, plan.current_velocity, plan.current_acceleration = start.tolist()
        plan.max_velocity, plan.max_acceleration, plan.max_jerk = [9.0] * COUNT, [most] * COUNT, jerk.tolist()
        otg.calculate(plan, stop)
        lower, upper = start[0] - 0.02, start[0] + 0.02
        found, inside, _, duration = planned(start, start[0], lower, upper, jerk, most=most)
        assert duration == pytest.approx(stop.duration, abs=1e-12)
        times = np.linspace(0.0, 1.1 * stop.duration, 1000)
        states = np.empty((len(times), 3, COUNT))
        follow_stop(found, times, states)
        theirs = np.array([stop.at_time(time) for time in times.tolist()])
        assert np.abs(states[:, :2] - theirs[:, :2]).max() < 1e-10
        assert np.abs(states[:, 2] - theirs[:, 2]).max() < 1e-8
        path, span = states[:, 0], found.span
        assert np.abs(span[0] - path.min(axis=0)).max() < 1e-3
        assert np.abs(span[1] - path.max(axis=0)).max() < 1e-3
        assert np.all((span[0] <= path.min(axis=0) + 1e-12) & (path.max(axis=0) - 1e-12 <= span[1]))
        assert inside == bool(np.all((span[0] >= lower) & (span[1] <= upper)))
        end = found.end
        turned += bool(np.any((span[0] < np.minimum(start[0], end)) | (span[1] > np.maximum(start[0], end))))
        plateaus += bool(np.any(found.plateau > 0.0))
        outside += not inside
    assert turned > 100
    assert plateaus > 100
    assert 0 < outside < 600


def test_who_begins_outside_may_stay_there_and_a_number_that_is_none_never_may() -> None:
    start = np.array([[2.0], [0.0], [0.0]])
    lower, upper, jerk = np.array([-1.0]), np.array([1.0]), np.array([10.0])
    _, inside, outside, _ = planned(start, start[0], lower, upper, jerk)
    assert inside
    assert outside
    assert not planned(np.array([[2.001], [0.0], [0.0]]), start[0], lower, upper, jerk)[1]
    for row in range(3):
        bad = start.copy()
        bad[row] = np.nan
        assert not planned(bad, start[0], lower, upper, jerk)[1]


def test_what_came_inside_does_not_leave_again() -> None:
    jerk, lower, upper = np.array([100.0]), np.array([-1.0]), np.array([1.0])
    # This stop starts outside, its speed takes it inside, and its acceleration takes it outside again.
    here, start = np.array([1.01]), np.array([[1.005], [-0.3], [9.0]])
    stop, inside, _, _ = planned(start, here, lower, upper, jerk)
    assert stop.span[0, 0] < 1.0 < stop.end[0] < here[0]
    assert not inside
    # A stop that moves inside and stays there is permitted.
    stop, inside, _, _ = planned(np.array([[1.005], [-0.3], [0.0]]), here, lower, upper, jerk)
    assert stop.end[0] < 1.0
    assert inside
    # A stop that remains outside may turn outwards again, but no farther than the joint was before.
    start = np.array([[1.005], [-0.01], [2.0]])
    stop, inside, _, _ = planned(start, np.array([1.05]), lower, upper, jerk)
    assert 1.0 < stop.span[0, 0] < 1.005 < stop.end[0]
    assert inside
    assert not planned(start, start[0], lower, upper, jerk)[1]


def test_one_angle_outside_is_outside() -> None:
    lower, upper, jerk = np.array([-1.0, 0.0]), np.array([1.0, 0.5]), np.full(2, 10.0)

    def outside(*angles: float) -> bool:
        state = np.array([angles, (0.0, 0.0), (0.0, 0.0)])
        return planned(state, state[0], lower, upper, jerk)[2]

    assert not outside(-1.0, 0.5)
    for angles in ((-1.1, 0.2), (1.1, 0.2), (0.0, -0.1), (0.0, 0.6)):
        assert outside(*angles)


def test_a_stop_beside_a_coupling_is_told_from_one_that_keeps_it() -> None:
    state = np.array([[0.1, 0.2], [0.5, 0.0], [0.0, 0.0]])
    limits = at.Limits(*np.array([[-1.0, -1.0], [1.0, 1.0], [10.0, 10.0], [100.0, 100.0]]))
    stop = at.empty_stop(2)
    for high, kept in ((0.5, True), (0.31, False)):
        _, keeps, _, _ = plan_stop(
            state, state[0], limits, np.ones((1, 2)), np.array([-1.0]), np.array([high]), stop
        )
        assert keeps is kept


def test_room_is_taken_on_the_side_where_a_servo_is_away() -> None:
    measured, box = np.array([0.5, 0.0, -0.5, 2.0]), np.zeros((2, 4))
    span = np.array([[0.1, 0.2, 1.0], [0.4, 0.3, 1.5]])
    take_room(np.array([0, 2, 3]), measured, np.array([0.25, 0.25, 2.0]), span, box)
    assert box.tolist() == [[0.1, 0.0, -0.55, 1.0], [0.65, 0.0, 0.3, 1.5]]
