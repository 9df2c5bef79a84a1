"""Streams of set-points: followed without lag, ended where they ended."""

from __future__ import annotations

import numpy as np
import pytest

from tci.middleware.yarp.set_points import ENDED, KEPT, SetPoints

PERIOD = 0.005
SPEED, BRAKE = 5.0, 40.0


def fed(points: SetPoints, values: list[float]) -> list[float]:
    return [float(points.lead([0], np.array([v]), 10.0 + n * PERIOD)[0]) for n, v in enumerate(values)]


def make() -> SetPoints:
    return SetPoints(np.array([SPEED]), np.array([BRAKE]))


def test_a_steady_stream_is_led_by_the_distance_of_a_stop() -> None:
    values = [2.0 * PERIOD * n for n in range(20)]
    went = fed(make(), values)
    assert went[: KEPT - 1] == values[: KEPT - 1]
    np.testing.assert_allclose(np.array(went[KEPT - 1 :]) - values[KEPT - 1 :], 2.0**2 / (2 * BRAKE))


@pytest.mark.parametrize(
    "values",
    [[0.0] * 9 + [1.0] * 9, [0.0, 1.0] * 9, [1.0], [0.0] * 30],
    ids=["step", "zigzag", "one", "rest"],
)
def test_what_is_no_motion_is_not_led(values: list[float]) -> None:
    assert fed(make(), values) == values


def test_a_stream_is_never_led_faster_than_its_joint_may_go() -> None:
    went = fed(make(), [float(n) for n in range(10)])
    assert went[-1] == pytest.approx(9.0 + SPEED**2 / (2 * BRAKE))


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
        went.append(float(points.lead([0], np.array([value]), arrived)[0]) - value)
    assert max(went[50:]) <= went[45] * 1.01


def test_a_robot_that_holds_is_not_led_back_to_a_set_point_from_before() -> None:
    points = make()
    fed(points, [2.0 * PERIOD * n for n in range(20)])
    points.forget()
    assert points.last(10.0 + 19 * PERIOD + ENDED * 1.1) is None
    assert fed(points, [3.0]) == [3.0], "and a new stream begins anew"
