"""The path on which servos that are outside their limits return inside: its speed, and its end if a coupling
or the check for self-collision refuses it."""

from __future__ import annotations

import numpy as np
import pytest
from ruckig import RuckigError

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot
from tci.gate.acceptance import SLOWEST
from tci.gate.bounds import bounds_of
from tci.gate.stop_plan import StopTrajectory
from tci.gate.trajectory import OnlineTrajectory
from tci.gate.way_inside import (
    AT_LIMIT,
    CREEP,
    LAGS,
    OUTSIDE,
    QUICK,
    SAGS,
    UNPLANNED,
    creeping,
    sags,
    was_there,
)
from tci.messages import Mode, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array
from tci.reasons import Code, Reason

LIMIT = 2.0
OUT = 0.1
"""Distance [rad] of the first servo outside its upper limit at the start."""
NEAR = Reason(Code.SELF_COLLISION, "near")


def limiter(refused: set[int], start: float = LIMIT + OUT) -> OnlineTrajectory:
    """Returns a trajectory of three servos, the first one at `start` [rad]. A stop is refused if it moves one
    of the servos `refused`."""

    def guard(stop: StopTrajectory) -> Reason | None:
        moved = np.abs(stop.span - stop.here).max(axis=0) > 1e-9
        return NEAR if moved[list(refused)].any() else None

    bounds, _ = bounds_of(make_robot(coupled=False), [0, 1, 2], speed_share=1.0)
    return OnlineTrajectory(bounds, np.array([start, 0.0, 0.0]), PERIOD, guard=guard)


def go(trajectory: OnlineTrajectory, seconds: float) -> tuple[Array, list[Reason]]:
    """Returns the path, and the reasons for which the trajectory ended motions on this path."""
    path, told = [trajectory.state[0].copy()], []
    for _ in range(round(seconds / PERIOD)):
        path.append(trajectory.step().copy())
        told += [] if trajectory.ended is None else [trajectory.ended]
    return np.array(path), told


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.VELOCITY])
def test_a_servo_with_a_high_limit_of_speed_comes_in_as_slowly_as_others(mode: Mode) -> None:
    """In an earlier version the speed was a tenth of the servo's speed limit. For a G1's waist this is 191
    degrees/s."""
    fast = LIMITS.model_copy(update={"velocity": 37.0, "acceleration": 4000.0, "jerk": 400_000.0})
    driven = Driven(make_robot(limits=fast, modes=(Mode.TORQUE, mode)), [0, 0, 2.3, 0, 0, 0])
    driven.step(PlatformSwitch(np.array([2]), mode))
    driven.settle()
    path = np.array(driven.path)[:, 2]
    assert path[-1] <= LIMIT
    assert 0.9 * CREEP * QUICK < np.abs(np.diff(path)).max() / PERIOD <= 1.001 * CREEP * QUICK


@pytest.mark.parametrize("out", [1.2e-6, -1e-7, 0.9 * AT_LIMIT])
@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.VELOCITY])
def test_a_servo_that_rests_at_its_limit_starts_there_whatever_its_last_digits_say(
    out: float, mode: Mode
) -> None:
    """An Atlas whose wrists start at the end of their range was sent angles 1e-7 to 1.2e-6 rad beyond it."""
    start = LIMIT + out if out > 0.0 else -1.0 + out
    driven = Driven(make_robot(modes=(mode,)), [0.0, 0.0, start, 0.0, 0.0, 0.0])
    safe = driven.step(PlatformCommand(mode, np.array([2, 3]), np.array([0.0, 0.1]), np.full(2, np.inf)))
    assert -1.0 <= safe.position[0] <= LIMIT
    assert abs(safe.position[0] - start) <= AT_LIMIT + 1e-5, "and does not jump"


def test_a_straight_way_of_fast_and_slow_servos_stays_straight() -> None:
    trajectory = limiter(set())
    trajectory.aim(np.array([1.9, 0.5, 0.1]), np.array([30.0, 3.0, 1.0]))
    trajectory._set_straight(True)
    path, _ = go(trajectory, 1.0)
    way = path - path[0]
    assert way[-1, 1] > 1e-3
    np.testing.assert_allclose(way[:, 2], way[:, 1] / 5.0, atol=1e-9)


def test_a_servo_that_may_not_come_in_lets_the_others_follow_their_targets() -> None:
    trajectory = limiter({0})
    trajectory.aim(np.array([1.5, 0.2, 0.0]), np.full(3, 1.0))
    path, told = go(trajectory, 4.0)
    assert path[-1, 1] == pytest.approx(0.2, abs=1e-6)
    assert np.ptp(path[:, 0]) == 0.0
    assert told == [NEAR]


def test_a_refusal_that_ends_the_other_motions_too_is_reported() -> None:
    """In an earlier version only the first refusal was reported: the motion of the other servos ended without
    a word."""
    refused = {0}
    trajectory = limiter(refused)
    trajectory.aim(np.array([1.5, 0.5, 0.0]), np.full(3, 1.0))
    _, told = go(trajectory, 0.3)
    assert told == [NEAR]
    refused.add(1)
    path, told = go(trajectory, 2.0)
    assert told == [NEAR]
    assert path[-1, 1] < 0.4


def test_a_servo_that_may_not_come_in_lets_the_others_keep_their_velocities() -> None:
    trajectory = limiter({0})
    trajectory.drive_at([0, 1], np.array([0.0, 0.2]))
    path, told = go(trajectory, 1.0)
    assert path[-1, 1] > 0.15
    assert np.ptp(path[:, 0]) == 0.0
    assert told == [NEAR]


def test_a_servo_that_may_not_come_in_stops_also_if_it_is_driven() -> None:
    trajectory = limiter({0})
    trajectory.drive_at([0, 1], np.array([-0.05, 0.2]))
    path, told = go(trajectory, 1.0)
    assert path[-1, 1] > 0.15
    assert np.ptp(path[:, 0]) == 0.0
    assert told == [NEAR]


def beside_a_coupling() -> OnlineTrajectory:
    """Returns a trajectory of three servos, the first one 0.1 rad below its lower limit. A motion inside
    would violate its coupling with the second servo."""
    robot = make_robot()
    tight = robot.couplings[0].model_copy(update={"upper": -0.5})
    bounds, _ = bounds_of(robot.model_copy(update={"couplings": (tight,)}), [0, 1, 2], speed_share=1.0)
    return OnlineTrajectory(bounds, np.array([-1.0 - OUT, -0.6, 0.0]), PERIOD)


def test_a_way_inside_that_a_coupling_refuses_lets_the_others_keep_their_velocities() -> None:
    trajectory = beside_a_coupling()
    trajectory.drive_at([0, 2], np.array([0.0, 0.2]))
    path, told = go(trajectory, 1.0)
    assert told[:1] == [OUTSIDE]
    assert path[-1, 2] > 0.15
    assert (path[:, 0] - path[:, 1]).max() <= -0.5 + 1e-9


def test_a_motion_that_is_refused_does_not_end_the_way_inside_of_another_servo() -> None:
    """In an earlier version a servo outside its limits stayed there until the next command, and started
    farther outside each time."""
    trajectory = limiter({1})
    trajectory.aim(np.array([1.5, 0.2, 0.0]), np.full(3, 1.0))
    path, told = go(trajectory, 4.0)
    assert told == [NEAR]
    assert LIMIT - 1e-4 < path[-1, 0] <= LIMIT
    assert np.abs(np.diff(path[:, 0])).max() / PERIOD <= 1.001 * CREEP
    assert trajectory.rests


@pytest.mark.parametrize("straight", [False, True])
def test_a_servo_comes_in_also_if_a_command_asks_for_the_least_speed(straight: bool) -> None:
    """In an earlier version the group was to move at a tenth of this speed, which takes longer than ruckig
    plans. So no servo of the group moved at all."""
    trajectory = limiter(set())
    trajectory.aim(np.array([1.5, 1.9, 0.0]), np.full(3, SLOWEST))
    trajectory._set_straight(straight)
    path, _ = go(trajectory, 4.0)
    way = path[0] - path[-1]
    assert -way[1] == pytest.approx(4.0 * SLOWEST, rel=0.1)
    assert 0.1 * SLOWEST < way[0] <= 4.0 * SLOWEST
    assert np.abs(np.diff(path, axis=0)).max() / PERIOD <= 1.001 * SLOWEST


def count_plans(trajectory: OnlineTrajectory, monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """Returns a list that grows by one entry with each calculation of a motion."""
    plans: list[None] = []
    otg = trajectory._planner._otg

    class Counted:
        def update(self, *args: object) -> object:
            plans.append(None)
            return otg.update(*args)

        def reset(self) -> None:
            otg.reset()

    monkeypatch.setattr(trajectory._planner, "_otg", Counted())
    return plans


def fail_once(trajectory: OnlineTrajectory, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the calculation with this number, counted from 1, fail."""
    otg, calls = trajectory._planner._otg, [0]

    class FailsOnce:
        def update(self, *args: object) -> object:
            calls[0] += 1
            if calls[0] == number:
                raise RuckigError("no way")
            return otg.update(*args)

        def reset(self) -> None:
            otg.reset()

    monkeypatch.setattr(trajectory._planner, "_otg", FailsOnce())


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.VELOCITY])
@pytest.mark.parametrize("blocked", [{0}, {0, 1}])
def test_a_refused_way_inside_is_tried_again_only_with_a_command(
    mode: Mode, blocked: set[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In an earlier version it was tried in each period, with up to three calculations. So a joint could move
    minutes after its command."""
    refused = {*blocked}
    trajectory = limiter(refused)

    def command() -> None:
        if mode is Mode.VELOCITY:
            trajectory.drive_at([0, 1, 2], np.zeros(3))
        else:
            trajectory.aim(np.array([1.5, 0.2, 0.0]), np.full(3, 1.0))

    command()
    _, told = go(trajectory, 4.0)
    assert told == [NEAR]
    plans = count_plans(trajectory, monkeypatch)
    trajectory.measured = trajectory.state[0]  # servos inside their limits do not sag
    go(trajectory, 0.1)
    assert len(plans) <= (50 if mode is Mode.VELOCITY else 0)
    refused.clear()
    path, told = go(trajectory, 4.0)
    assert np.ptp(path[:, 0]) == 0.0
    assert not told
    command()
    path, told = go(trajectory, 4.0)
    assert path[-1, 0] <= LIMIT
    assert not told


def test_a_way_inside_that_a_coupling_refuses_is_tried_again_only_with_a_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    trajectory = beside_a_coupling()
    trajectory.drive_at([0, 2], np.array([0.0, 0.0]))
    _, told = go(trajectory, 1.0)
    assert told == [OUTSIDE]
    plans = count_plans(trajectory, monkeypatch)
    go(trajectory, 0.1)
    assert len(plans) <= 50


def test_a_calculation_that_fails_at_rest_does_not_end_the_way_inside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The third calculation is the first one for the servo outside its limits alone."""
    trajectory = limiter({1})
    trajectory.aim(np.array([1.5, 0.2, 0.0]), np.full(3, 1.0))
    fail_once(trajectory, 3, monkeypatch)
    path, told = go(trajectory, 4.0)
    assert told == [NEAR]
    assert LIMIT - 1e-4 < path[-1, 0] <= LIMIT


def test_a_refused_way_inside_is_tried_again_while_other_servos_of_the_group_move() -> None:
    refused = {0}
    trajectory = limiter(refused)
    trajectory.aim(np.array([1.9, 1.5, 0.0]), np.full(3, 1.0))
    path, _ = go(trajectory, 0.5)
    assert np.ptp(path[:, 0]) == 0.0
    refused.clear()
    path, _ = go(trajectory, 20.0)
    assert path[-1, 0] <= LIMIT


def test_a_calculation_that_fails_is_not_called_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """In an earlier version the reason was that of a coupling or limit that prevents the way inside."""
    trajectory = limiter(set())
    trajectory.drive_at([0, 1], np.array([0.0, 0.2]))
    go(trajectory, 0.1)
    fail_once(trajectory, 1, monkeypatch)
    path, told = go(trajectory, 2.0)
    assert told == [UNPLANNED]
    assert path[-1, 0] <= LIMIT


def test_another_reason_is_reported_after_a_calculation_that_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    """In an earlier version no refusal was reported until a step inside succeeded."""
    refused: set[int] = set()
    trajectory = limiter(refused)
    trajectory.drive_at([0, 1], np.array([0.0, 0.2]))
    go(trajectory, 0.1)
    fail_once(trajectory, 1, monkeypatch)
    _, told = go(trajectory, PERIOD)
    assert told == [UNPLANNED]
    refused.add(0)
    _, told = go(trajectory, 0.1)
    assert told == [NEAR]


def test_a_halt_ends_the_way_inside() -> None:
    trajectory = limiter({1})
    trajectory.aim(np.array([1.5, 0.2, 0.0]), np.full(3, 1.0))
    go(trajectory, 0.2)
    trajectory.halt()
    path, _ = go(trajectory, 1.0)
    assert path[-1, 0] > LIMIT
    assert path[-1, 0] == path[-2, 0]
    assert trajectory.rests


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("sag", [0.2 * SAGS, 0.9 * SAGS])
def test_a_servo_that_may_not_come_in_is_held_where_it_was_found(side: float, sag: float) -> None:
    """In an earlier version the servo was held at the position to which it had sagged, so that each new start
    moved it farther outside."""
    start = LIMIT + OUT if side > 0.0 else -1.0 - OUT
    trajectory = limiter({0}, start)
    trajectory.aim(np.array([1.5, 0.0, 0.0]), np.full(3, 1.0))
    for _ in range(1000):
        trajectory.measured = trajectory.step() + np.array([side * sag, 0.0, 0.0])
    held = side * (trajectory.measured[0] - start)
    assert 0.0 <= held < 0.05 * sag


def test_a_joint_that_was_pushed_far_outside_is_not_led_far_inside() -> None:
    """If the reference were far inside, a released joint would move there suddenly."""
    trajectory = limiter({0})
    trajectory.aim(np.array([1.5, 0.0, 0.0]), np.full(3, 1.0))
    for _ in range(1000):
        trajectory.measured = trajectory.step() + np.array([0.3, 0.0, 0.0])
    assert LIMIT + OUT - SAGS - 1e-9 <= trajectory.state[0][0] < LIMIT + OUT - 0.5 * SAGS


def test_after_a_calculation_that_fails_no_step_is_taken_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ruckig went on with the trajectory of the failed calculation: a G1's wrist jumped by two steps."""
    trajectory = limiter(set())
    trajectory.drive_at([1], np.array([0.5]))
    go(trajectory, 0.02)
    reset: list[None] = []
    otg = trajectory._planner._otg

    class Failing:
        """Fails at the first of each two calculations."""

        calls = 0

        def update(self, *args: object) -> object:
            self.calls += 1
            if self.calls % 2:
                raise RuckigError("no way")
            return otg.update(*args)

        def reset(self) -> None:
            reset.append(None)
            otg.reset()

    monkeypatch.setattr(trajectory._planner, "_otg", Failing())
    path, _ = go(trajectory, 0.1)
    assert len(reset) == len(path) - 1
    assert np.abs(np.diff(path[:, 1], 3)).max() / PERIOD**3 <= LIMITS.jerk * 1.001


@pytest.mark.parametrize("angle", [-1.0, LIMIT])
def test_a_servo_at_its_limit_is_not_outside(angle: float) -> None:
    assert not limiter(set(), angle).outside
    assert limiter(set(), np.nextafter(angle, 9.0 * angle)).outside


def test_each_servo_creeps_at_a_fraction_of_its_own_speed_unless_the_way_is_straight() -> None:
    speed = np.array([30.0, 3.0, 1.0])
    assert creeping(speed, straight=False) == pytest.approx([CREEP * QUICK, 0.3, 0.1])
    assert creeping(speed, straight=True) == pytest.approx(speed * CREEP * QUICK / 30.0)
    least = np.array([SLOWEST, 0.5 * SLOWEST])
    assert creeping(least, straight=False) == pytest.approx(least)


@pytest.mark.parametrize(
    ("here", "sag", "sagged"),
    [(2.1, 2.0, True), (2.1, 1.0, False), (2.1, -2.0, False), (-1.1, -2.0, True), (-1.1, 2.0, False),
     (2.0, 2.0, False), (-1.0, -2.0, False), (0.0, 2.0, False)],
)  # fmt: skip
def test_only_a_servo_outside_its_limits_that_moved_farther_out_sags(
    here: float, sag: float, sagged: bool
) -> None:
    """The sag is a multiple of `LAGS`. The other servo is inside its limits."""
    bounds, _ = bounds_of(make_robot(coupled=False), [0, 1], speed_share=1.0)
    found = np.zeros(2)
    assert sags(np.array([here, 0.0]), bounds, found, np.array([sag, 9.0]) * LAGS) is sagged


@pytest.mark.parametrize("out", [1.0, -1.0])
@pytest.mark.parametrize(
    ("sag", "moved", "other", "known"),
    [(2.0, 1.0, 0.0, True), (1.0, 1.0, 0.0, True), (0.5, 1.0, 0.0, False), (4.0, 3.0, 0.0, False),
     (2.0, 1.0, 0.1, False), (2.0, 1.0, -0.1, False)],
)  # fmt: skip
def test_a_way_is_known_up_to_where_the_servo_was_found(
    out: float, sag: float, moved: float, other: float, known: bool
) -> None:
    """The first servo was found at 4 rad. Sag and motion inward are multiples of 2^-8 rad, which is about
    half of `SAGS`."""
    step = out * 2.0**-8
    here = np.array([4.0 * out, 1.0])
    ends = np.array([[4.0 * out, 1.0], [4.0 * out - moved * step, 1.0 + other]])
    span = np.array([ends.min(axis=0), ends.max(axis=0)])
    measured = np.array([4.0 * out + sag * step, 1.0])
    assert was_there(np.array([-0.3 * out, 0.0]), here, span, here, measured) is known
