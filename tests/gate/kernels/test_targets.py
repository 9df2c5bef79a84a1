"""The compiled checks of a command's targets give the same results as checks in NumPy and Python."""

from __future__ import annotations

import numpy as np
import pytest

from tci.gate.kernels.targets import (
    FAR_OFF,
    INVALID,
    SPEED,
    TARGET,
    is_acceptable,
    is_far_off,
    straight_limits,
    take_targets,
)

SERVOS, VALUES, SPEEDS = np.array([3, 0, 5]), np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, np.inf])
BOX = np.array([[-1.0] * 6, [1.0] * 6])
FAR, SLOWEST = 0.5, 1e-3
RULES = BOX, FAR, SLOWEST


def test_a_command_is_acceptable_and_without_servos_none_is() -> None:
    assert is_acceptable(SERVOS, VALUES, SPEEDS, 6, 1.0)
    assert not is_acceptable(SERVOS[:0], VALUES[:0], SPEEDS[:0], 6, 1.0)


@pytest.mark.parametrize("place", range(3))
def test_one_wrong_number_at_any_place_is_seen(place: int) -> None:
    for servo in (-1, 6, 2**62, SERVOS[(place + 1) % 3]):
        servos = SERVOS.copy()
        servos[place] = servo
        assert not is_acceptable(servos, VALUES, SPEEDS, 6, 1.0)
    for value in (np.nan, np.inf, -np.inf):
        values = VALUES.copy()
        values[place] = value
        assert not is_acceptable(SERVOS, values, SPEEDS, 6, 1.0)
    for speed in (np.nan, 0.999, -np.inf):
        speeds = SPEEDS.copy()
        speeds[place] = speed
        assert not is_acceptable(SERVOS, VALUES, speeds, 6, 1.0)


def test_values_go_to_their_servos_places_and_come_back_from_there() -> None:
    index, free = np.array([0, 2, 3, 4]), np.ones(4, bool)
    limits = np.array([[-0.15] * 4, [0.2] * 4, [1.5, 0.1, 1.0, 0.1]])
    aims, sent = np.array([[9.0] * 4, [8.0] * 4, [7.0] * 4]), np.full(3, 7.0)
    farthest = take_targets(
        (SERVOS, VALUES, SPEEDS),
        *RULES,
        (index, limits, np.zeros((0, 4)), np.zeros((2, 0)), free, aims),
        sent,
    )
    assert aims[TARGET].tolist() == pytest.approx([-0.15, 9.0, 0.1, 9.0], abs=1e-5)
    assert aims[SPEED].tolist() == [1.5, 8.0, 1.0, 8.0]
    assert sent.tolist() == pytest.approx([0.1, -0.15, 7.0], abs=1e-5)
    assert farthest == pytest.approx(0.05, abs=1e-5)


def test_between_limits_that_are_near_a_value_goes_to_the_middle() -> None:
    one, aims, sent = np.zeros(1, np.intp), np.zeros((3, 1)), np.zeros(1)
    limits = np.array([[0.0], [1e-7], [1.0]])
    none = np.zeros((0, 1)), np.zeros((2, 0)), np.zeros(1, bool)
    take_targets((one, np.array([1.4]), np.ones(1)), *RULES, (one, limits, *none, aims), sent)
    assert sent.tolist() == [0.5e-7]


def test_a_command_that_is_refused_changes_nothing() -> None:
    index, limits = np.array([0, 3, 5]), np.array([[-1.0] * 3, [1.0] * 3, [1.0] * 3])
    for values, speed, expected in (
        ((0.1, np.nan, 0.3), 1.0, INVALID),
        ((0.1, -0.2, 0.3), 0.5 * SLOWEST, INVALID),
        ((0.1, -0.2, 6.3), 1.0, FAR_OFF),
        ((1.6, -1.6, 1.6), 1.0, FAR_OFF),
    ):
        aims, sent, free = np.full((3, 3), 9.0), np.full(3, 7.0), np.ones(3, bool)
        numbers = SERVOS, np.array(values), np.full(3, speed)
        assert is_far_off(SERVOS, numbers[1], BOX, FAR) is (expected == FAR_OFF)
        none = np.zeros((0, 3)), np.zeros((2, 0)), free
        assert take_targets(numbers, *RULES, (index, limits, *none, aims), sent) == expected
        assert (aims == 9.0).all()
        assert (sent == 7.0).all()


def test_a_target_beyond_a_coupling_goes_next_to_it_and_servos_that_nobody_asked_stay() -> None:
    index, free = np.array([0, 3]), np.zeros(2, bool)
    limits = np.array([[-1.0] * 2, [1.0] * 2, [1.0] * 2])
    ends = np.array([[-0.3], [0.3]])
    aims, sent = np.array([[0.2, 0.0], [1.0, 1.0], [0.0, 0.0]]), np.zeros(1)
    farthest = take_targets(
        (np.array([3]), np.array([0.5]), np.ones(1)),
        *RULES,
        (index, limits, np.array([[1.0, 1.0]]), ends, free, aims),
        sent,
    )
    assert aims[TARGET].tolist() == pytest.approx([0.2, 0.1], abs=1e-5)
    assert farthest == pytest.approx(0.4, abs=1e-5)


def test_limits_in_the_ratio_of_the_ways_are_as_large_as_they_may_be() -> None:
    random = np.random.default_rng(2)
    for _ in range(200):
        count = random.integers(1, 7)
        here, target = random.normal(size=(2, count))
        target = np.where(random.random(count) < 0.2, here, target)
        given = random.uniform(0.1, 10.0, (3, count))
        limits = np.empty((3, count))
        straight_limits(here, target, *given, 1e-6, 1e-3, limits)
        way = np.abs(target - here)
        share = np.maximum(way / max(float(way.max()), 1e-6), 1e-3)
        assert np.array_equal(limits, [share * np.min(limit / share) for limit in given])
